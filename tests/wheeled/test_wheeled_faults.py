"""The adapter on a base that fails, is taken over or is lied about: it stops, says why, and stays stopped."""

import contextlib
import dataclasses
import itertools
import random
import threading
import time

import can
import pytest
from wheeled_rig import STANDBY, STILL, InProcess, base_profile, drive, tapped, until

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.platform import Scenario
from adatracker_wheeled.platform import WheeledPlatform
from adatracker_wheeled.sim.fuzz import frames
from adatracker_wheeled.sim.simulator import Simulator
from adatracker_wheeled.sim.socketcand import SocketcandServer
from tests.driving import send_for
from tests.kept import blocks_in_use
from tests.tiers import EXHAUSTIVE, sampled

pytestmark = pytest.mark.slow

AHEAD = Twist(vx=0.5)


def keep_sending(platform, within_s=3.0):
    """Send until it is refused; return why and after how long."""
    begun_s = time.monotonic()
    with pytest.raises(PlatformError) as refused:
        send_for(platform, AHEAD, within_s)
    return str(refused.value), time.monotonic() - begun_s


# Somebody else drives


def test_a_remote_control_has_the_base_for_good():
    with tapped() as (platform, simulator, tap):
        platform.engage()
        send_for(platform, AHEAD, 0.5)
        simulator.inject("remote")
        took_s = until(lambda: platform.state().stopped)
        print(f"takeover noticed after {took_s * 1e3:.0f} ms")
        assert took_s < 0.2
        assert platform.state().taken_over
        assert "remote control" in platform.state().stopped
        tap.frames()
        with pytest.raises(PlatformError, match="remote control"):
            platform.send(AHEAD, platform.clock.now_ns())
        platform.hold("too late")
        platform.disengage()
        with pytest.raises(PlatformError, match="remote control"):
            platform.engage()
        platform.disengage()
        simulator.inject("remote", begin=False)
        until(lambda: platform.state().mode == "standby")
        platform.hold("still not ours")
        assert tap.commands() == []
        platform.engage()
        assert not platform.state().stopped
        assert not platform.state().taken_over
        send_for(platform, AHEAD, 0.5)
        assert platform.state().velocity.vx > 0.2


def test_closing_leaves_a_base_alone_that_was_taken_over():
    with tapped() as (platform, simulator, tap):
        platform.engage()
        send_for(platform, AHEAD, 0.3)
        simulator.inject("remote")
        until(lambda: platform.state().stopped)
        tap.frames()
        platform.close()
        assert tap.commands() == []


def test_a_base_that_somebody_else_disables_is_let_go():
    with tapped() as (platform, _, tap):
        platform.engage()
        send_for(platform, AHEAD, 0.3)
        tap.send(*STANDBY)
        until(lambda: platform.state().stopped)
        assert "somebody else on the bus commands the base (frames 0x421)" in platform.state().stopped
        assert platform.state().taken_over
        tap.frames()
        platform.disengage()
        assert tap.commands() == []


# The base fails

FAILURES = {
    "emergency_stop": ("emergency stop is pressed", 0.25),
    "fault": ("battery under-voltage", 0.25),
    "frozen_feedback": ("no measured motion", 0.35),
    "frozen_state": ("no new state", 0.75),
    "silence": ("no measured motion", 0.35),
}
"""What is said, and within how many seconds: the message's period or time-out, and slack."""


@pytest.mark.parametrize("fault", sampled(FAILURES, everyday=("silence",)))
def test_a_failing_base_is_stopped_and_stays_so_until_an_explicit_engage(fault):
    said, within_s = FAILURES[fault]
    with tapped() as (platform, simulator, tap):
        platform.engage()
        send_for(platform, AHEAD, 0.5)
        simulator.inject(fault)
        why, took_s = keep_sending(platform)
        print(f"{fault}: stopped after {took_s * 1e3:.0f} ms")
        assert said in why
        assert said in platform.state().stopped
        assert took_s < within_s
        assert tap.commands_until_quiet()[-3:] == [STILL] * 3
        until(lambda: abs(simulator.simulator.body.measured.vx) < 0.02)
        simulator.inject(fault, begin=False)
        platform.clock.sleep_until(platform.clock.now_ns() + 300_000_000)
        with pytest.raises(PlatformError, match=said):
            platform.send(AHEAD, platform.clock.now_ns())
        assert tap.commands() == []
        platform.engage()
        send_for(platform, AHEAD, 0.5)
        assert simulator.simulator.body.measured.vx > 0.2


@pytest.mark.parametrize("fault", FAILURES)
def test_a_failure_is_noticed_also_while_nobody_sends(fault):
    with drive() as (platform, simulator):
        platform.engage()
        simulator.inject(fault)
        until(lambda: platform.state().stopped, within_s=1.5)
        assert not platform.state().engaged


@pytest.mark.parametrize(
    ("fault", "check"),
    [
        ("emergency_stop", "emergency stop"),
        ("fault", "faults"),
        ("remote", "remote control"),
        ("frozen_feedback", "feedback"),
        ("low_battery", "battery"),
    ],
)
def test_the_preflight_refuses_an_unfit_base_and_names_what_is_wrong(fault, check):
    with drive(base_profile(faults=(fault,))) as (platform, _):
        assert [found.name for found in platform.preflight() if not found.ok] == [check]


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("emergency_stop", "emergency stop is pressed"),
        ("fault", "battery under-voltage"),
        ("remote", "remote control"),
        ("frozen_feedback", "did not obey within 1 s: no measured motion"),
        ("frozen_state", "no new state|did not obey"),
    ],
)
def test_an_unfit_base_is_not_engaged(fault, said):
    with tapped() as (platform, simulator, tap):
        simulator.inject(fault)
        platform.clock.sleep_until(platform.clock.now_ns() + 250_000_000)
        begun_s = time.monotonic()
        with pytest.raises(PlatformError, match=said):
            platform.engage()
        assert time.monotonic() - begun_s < 1.8
        assert not platform.state().engaged
        assert {data for number, data in tap.commands() if number == 0x111} <= {bytes(8)}


def test_a_silent_base_is_said_within_the_second():
    begun_s = time.monotonic()
    with (
        pytest.raises(PlatformError, match="no state from the base within 1 s: no frame came at all"),
        drive(base_profile(faults=("silence",))),
    ):
        pass
    assert time.monotonic() - begun_s < 2.0


@pytest.mark.parametrize(
    ("spoken", "expected", "hint"),
    [
        ("scout_v1", "scout", "v1 profile, such as scout_v1"),
        ("scout", "scout_v1", "v2 profile, such as scout"),
    ],
)
def test_a_base_of_the_other_protocol_is_recognised(spoken, expected, hint):
    far, near = base_profile(spoken, channel="other"), base_profile(expected, channel="other")
    clock = MonotonicClock()
    with InProcess(far) as sitl, WheeledPlatform(near, clock) as platform:
        sitl.start(clock, Scenario())
        with pytest.raises(PlatformError, match=hint):
            platform.connect()


def test_limits_that_the_wire_cannot_say_are_refused():
    profile = base_profile("scout_v1")
    wide = dataclasses.replace(profile, limits=dataclasses.replace(profile.limits, forward_m_s=30.0))
    with pytest.raises(UsageError, match="lower them"):
        WheeledPlatform(wide, MonotonicClock()).connect()


def test_a_connect_that_is_interrupted_leaves_no_thread_on_the_bus():
    class Interrupted(MonotonicClock):
        def sleep_until(self, t_ns):
            raise KeyboardInterrupt

    before = set(threading.enumerate())
    with pytest.raises(KeyboardInterrupt):
        WheeledPlatform(base_profile(), Interrupted()).connect()
    assert not set(threading.enumerate()) - before


# Whoever sends fails


def test_a_sender_that_hangs_is_followed_by_zeros_then_silence_and_not_set_going_again():
    with tapped() as (platform, simulator, tap):
        platform.engage()
        send_for(platform, AHEAD, 1.0)
        hung_s = time.monotonic()
        said = tap.commands_until_quiet()
        silent_s = time.monotonic() - hung_s - 0.1
        assert said[-3:] == [STILL] * 3
        print(f"a hung sender: zeros, then silence after {silent_s:.2f} s")
        assert silent_s < 0.4
        until(lambda: simulator.simulator.body.measured.vx < 0.02)
        print(f"a hung sender: at rest after {time.monotonic() - hung_s:.2f} s")
        platform.clock.sleep_until(platform.clock.now_ns() + 300_000_000)
        tap.frames()
        with pytest.raises(PlatformError, match="the base has stopped by itself"):
            platform.send(AHEAD, platform.clock.now_ns())
        until(lambda: not platform.state().engaged)


def test_a_short_hiccup_of_the_sender_is_forgiven():
    with drive() as (platform, _):
        platform.engage()
        send_for(platform, AHEAD, 0.3)
        platform.clock.sleep_until(platform.clock.now_ns() + 300_000_000)
        send_for(platform, AHEAD, 0.5)
        assert platform.state().velocity.vx > 0.3


def test_stops_from_many_threads_end_in_one_stop():
    with tapped() as (platform, _, tap):
        platform.engage()
        send_for(platform, AHEAD, 0.3)

        def disengage():
            with contextlib.suppress(PlatformError):  # "the connection is being closed"
                platform.disengage()

        stops = (lambda: platform.hold("one"), disengage, platform.close, lambda: platform.hold("two"))
        threads = [threading.Thread(target=stop) for stop in stops * 3]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(10.0)
        assert not any(thread.is_alive() for thread in threads)
        assert tap.commands()[-1] in (STANDBY, STILL)
        assert not platform.state().engaged


# The wire fails


class OverSocketcand:
    """A simulator behind a socketcand in this process, which can be switched off and on."""

    def __init__(self, profile, clock):
        self._simulator = Simulator(profile.connection.roles, profile.sitl, Scenario(), clock)
        self._ended = threading.Event()
        self.server = SocketcandServer(0, self._simulator.hear)
        self.port = self.server.port
        self.profile = dataclasses.replace(
            profile,
            connection=dataclasses.replace(
                profile.connection, interface="socketcand", channel="can0", port=self.port
            ),
        )
        self._thread = threading.Thread(target=self._simulator.serve, args=(self._send, self._ended))
        self._thread.start()

    @property
    def body(self):
        return self._simulator.body

    def _send(self, frame):
        self.server.send(frame)

    def unplug(self):
        self.server.close()

    def plug_in(self):
        self.server = SocketcandServer(self.port, self._simulator.hear)

    def close(self):
        self._ended.set()
        self._thread.join()
        self.server.close()


@contextlib.contextmanager
def cable_pulled(after_s):
    """Give an adapter whose cable was pulled after it had driven for `after_s`, and its simulated base."""
    clock = MonotonicClock()
    with (
        contextlib.closing(OverSocketcand(base_profile(), clock)) as simulator,
        WheeledPlatform(simulator.profile, clock) as platform,
    ):
        platform.connect()
        platform.engage()
        send_for(platform, AHEAD, after_s)
        simulator.unplug()
        yield platform, simulator


def test_a_cable_that_is_pulled_stops_the_run_and_replugged_needs_an_explicit_engage():
    with cable_pulled(after_s=1.0) as (platform, simulator):
        why, took_s = keep_sending(platform)
        rest_s = took_s + until(lambda: simulator.body.measured.vx < 0.02)
        print(f"cable pulled at 0.5 m/s: latched after {took_s * 1e3:.0f} ms, at rest after {rest_s:.2f} s")
        assert "lost" in why
        assert took_s < 0.2
        assert rest_s < 1.1
        with pytest.raises(PlatformError, match="no socketcand answers"):
            platform.engage()
        simulator.plug_in()
        platform.clock.sleep_until(platform.clock.now_ns() + 300_000_000)
        with pytest.raises(PlatformError, match="not engaged"):
            platform.send(AHEAD, platform.clock.now_ns())
        assert simulator.body.measured.vx < 0.02
        platform.engage()
        send_for(platform, AHEAD, 0.5)
        assert simulator.body.measured.vx > 0.2
        platform.disengage()


def test_a_lost_bus_makes_disengage_say_so_once_and_close_still_works():
    with cable_pulled(after_s=0.3) as (platform, _):
        until(lambda: platform.state().stopped)
        with pytest.raises(PlatformError, match="is lost"):
            platform.disengage()
        platform.disengage()


# Hostile frames


@EXHAUSTIVE
@pytest.mark.parametrize("name", ["scout", "odrive_diff"])
def test_a_hundred_thousand_hostile_frames_move_nothing_and_fill_nothing(name):
    profile, noise = base_profile(name), random.Random(3)
    with tapped(profile) as (platform, simulator, tap):
        known = [message.arbitration_id for message in until_heard(tap)]
        before = blocks_in_use()
        for count, frame in enumerate(itertools.islice(frames(known, noise), 100_000)):
            message = can.Message(arbitration_id=frame.id, data=frame.data, is_extended_id=False)
            if not tap.is_demand(message):  # whoever may command a base could rightly move it
                tap.send(frame.id, frame.data)
            if count % 1000 == 0:  # the base's own frames come through all the same
                asked_ns = platform.clock.now_ns()
                until(lambda asked_ns=asked_ns: platform.state().t_ns > asked_ns)
                assert tap.commands() == []
        assert blocks_in_use() - before < 200_000  # 6 a frame; the newest 20,000 wait for a trial's CAN log
        assert simulator.simulator.body.wheels_m == (0.0, 0.0)
        assert not platform.state().engaged
        (check,) = [check for check in platform.preflight() if check.name == "frames"]
        assert "malformed frames were dropped" in check.message
        notices = platform.notices()
        assert [notice.startswith("CAN: ") for notice in notices].count(True) == 1
        assert len(notices) <= 3  # and each of the base's two warnings, once
        assert platform.notices() == ()


def until_heard(tap):
    """Return the frames of the base's first second."""
    frames = []
    until(lambda: frames.extend(tap.frames()) or len({f.arbitration_id for f in frames}) >= 4)
    return frames
