"""The wheeled adapter against a simulated base, over a real ``vcan0``: driving, and what ends it.

Run by ``test_socketcan.py``; by itself only where there is a ``vcan0`` that this process may take down.
"""

from __future__ import annotations

import re
import signal
import subprocess
import sys

import pytest

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.platform import Scenario
from adatracker_deploy.sim.process import SimulatorProcess
from adatracker_wheeled.platform import WheeledPlatform
from tests.wheeled.uml.driver import CRUISE, PERIOD_NS, scout_on
from tests.wheeled.uml.interfaces import add_vcan, remove, set_up
from tests.wheeled.uml.live_base import CLOCK, LiveBase

WAIT_S = 20.0
"""Far more than anything here takes, even on the single processor of a user-mode kernel."""
STOP_S = 1.2
"""From 0.5 m/s: 0.5 s until the base's own time-out, 0.4 s to brake with its lag, and late threads."""
NOTICED_S = 0.3
"""A lost interface is seen by the receive thread at once; the rest is the scheduler's."""


@pytest.fixture
def base():
    base = LiveBase(scout_on("vcan0"), "vcan0")
    yield base
    base.close()


@pytest.fixture
def platform(base):
    with WheeledPlatform(scout_on("vcan0"), CLOCK) as platform:
        platform.connect()
        yield platform


def drive(platform, until, limit_s=WAIT_S):
    """Command 0.5 m/s at 50 Hz until something holds."""
    give_up_ns = CLOCK.now_ns() + round(limit_s * 1e9)
    while not until():
        now_ns = CLOCK.now_ns()
        assert now_ns < give_up_ns, f"not within {limit_s:g} s"
        platform.send(CRUISE, now_ns)
        CLOCK.sleep_until(now_ns + PERIOD_NS)


def cruises(base):
    return lambda: base.speed_m_s > 0.9 * CRUISE.vx


def test_a_base_is_engaged_driven_held_and_disengaged(base, platform):
    assert not [check for check in platform.preflight() if check.blocking and not check.ok]
    platform.engage()
    assert base.base.mode == "ours"
    drive(platform, cruises(base))
    platform.hold("the test says so")
    base.wait_until_at_rest(WAIT_S)
    with pytest.raises(PlatformError, match="the test says so"):
        platform.send(CRUISE, CLOCK.now_ns())
    platform.disengage()
    base.wait_until(lambda: base.base.mode == "standby", WAIT_S)


def test_the_simulator_that_is_started_by_hand_serves_a_vcan():
    simulator = SimulatorProcess("adatracker_wheeled.sim.sitl", "simulated base")
    try:
        bus = ("--interface", "socketcan", "--channel", "vcan0")
        simulator.start(CLOCK, Scenario(), ["--profile", "scout", *bus])
        with WheeledPlatform(scout_on("vcan0"), CLOCK) as platform:
            platform.connect()
            platform.engage()
            drive(platform, lambda: platform.state().velocity.vx > 0.9 * CRUISE.vx)
            platform.disengage()
    finally:
        simulator.close()


def take_down():
    set_up("vcan0", False)


def take_up():
    set_up("vcan0")


def unplug():
    remove("vcan0")


def plug_in():
    add_vcan("vcan0")
    set_up("vcan0")


@pytest.mark.parametrize(("lose", "restore"), [(take_down, take_up), (unplug, plug_in)])
def test_an_interface_lost_while_driving_stops_the_base_until_an_explicit_engage(
    base, platform, lose, restore
):
    platform.engage()
    drive(platform, cruises(base))
    lost_ns = CLOCK.now_ns()
    lose()
    try:
        with pytest.raises(PlatformError, match="vcan0"):
            drive(platform, lambda: False)
        noticed_s = (CLOCK.now_ns() - lost_ns) / 1e9
        rest_s = (base.wait_until_at_rest(WAIT_S) - lost_ns) / 1e9
    finally:
        restore()
    print(f"{lose.__name__}: noticed after {noticed_s:.2f} s, at rest after {rest_s:.2f} s")
    assert noticed_s < NOTICED_S
    assert rest_s < STOP_S

    heard, a_second_on_ns = base.frames, CLOCK.now_ns() + 1_000_000_000
    while CLOCK.now_ns() < a_second_on_ns:
        with pytest.raises(PlatformError, match="not engaged"):
            drive(platform, lambda: False)
        CLOCK.sleep_until(CLOCK.now_ns() + PERIOD_NS)
    assert base.frames == heard
    assert not platform.state().engaged

    platform.engage()
    drive(platform, cruises(base))


@pytest.fixture
def driver(base):
    """A process that drives the base."""
    command = [sys.executable, "-m", "tests.wheeled.uml.driver"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        base.wait_until(lambda: cruises(base)() or process.poll() is not None, WAIT_S)
        yield process
        process.kill()


def test_a_stopped_process_sends_no_more_and_a_continued_one_does_not_drive_on(base, driver):
    driver.send_signal(signal.SIGSTOP)
    stopped_ns = CLOCK.now_ns()
    rest_s = (base.wait_until_at_rest(WAIT_S) - stopped_ns) / 1e9
    last_word_s = (base.heard_ns - stopped_ns) / 1e9
    print(f"SIGSTOP: the last frame after {last_word_s:.2f} s, at rest after {rest_s:.2f} s")
    assert last_word_s < 0.05
    assert rest_s < STOP_S
    driver.send_signal(signal.SIGCONT)
    reason, _ = driver.communicate(timeout=WAIT_S)
    assert re.search("no command for|no new state|no measured motion", reason), (
        reason
    )  # whichever it looks at first
    base.wait_until(lambda: base.base.mode == "standby", WAIT_S)
    base.wait_until_at_rest(0.1)
