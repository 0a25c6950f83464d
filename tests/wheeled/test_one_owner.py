"""One owner for each base: somebody else's commands, a base that somebody else has enabled, and a claim."""

import contextlib
import dataclasses
import os
import subprocess
import sys
import threading

import pytest
from wheeled_rig import COMMAND_MODE, STANDBY, STILL, InProcess, Tap, base_profile, drive, tapped, until

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.platform import Scenario
from adatracker_deploy.runtime.charge import ChargeMark
from adatracker_wheeled.platform import WheeledPlatform
from adatracker_wheeled.sim.simulator import Simulator
from adatracker_wheeled.sim.socketcand import SocketcandServer
from tests.driving import Engaging, send_for
from tests.other_machine import OfAnotherMachine
from tests.race import owners, race

pytestmark = pytest.mark.slow

AHEAD = Twist(vx=0.5)
THEIRS = (0x111, bytes.fromhex("0100 0000 0000 0000"))
COMMANDS = "somebody else on the bus commands the base"


@pytest.fixture(autouse=True)
def own_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("ADATRACKER_RUN_DIR", str(tmp_path))


def refused(platform):
    return {check.name: check.message for check in platform.preflight() if not check.ok}


def control(platform):
    """The preflight's judgement of who commands the base."""
    return next(check for check in platform.preflight() if check.name == "control")


@contextlib.contextmanager
def commanding(profile, *frames):
    """Somebody else sends frames, ten times a second."""
    over = threading.Event()

    def chatter():
        with contextlib.closing(Tap(profile)) as tap:
            while not over.wait(0.1):
                for frame in frames:
                    tap.send(*frame)

    thread = threading.Thread(target=chatter)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@pytest.mark.parametrize("frame", [THEIRS, STILL, STANDBY, COMMAND_MODE], ids=lambda frame: hex(frame[0]))
def test_somebody_elses_command_takes_the_base_over_for_good(frame):
    with tapped() as (platform, _, tap):
        platform.engage()
        send_for(platform, AHEAD, 0.3)
        tap.send(*frame)
        until(lambda: platform.state().stopped, within_s=0.2)
        assert COMMANDS in platform.state().stopped
        assert platform.state().taken_over
        tap.frames()
        with pytest.raises(PlatformError, match=COMMANDS):
            platform.send(AHEAD, platform.clock.now_ns())
        platform.hold("too late")
        platform.disengage()
        platform.close()
        assert tap.commands() == []


@pytest.mark.parametrize("taker", ["commander", "remote control"])
def test_whoever_takes_a_base_that_is_held_has_it(taker):
    """Between a trial's stop and its end the robot is not driven, and somebody may take it over."""
    with tapped() as (platform, simulator, tap):
        platform.engage()
        send_for(platform, AHEAD, 0.3)
        platform.hold("the trial is over")
        if taker == "commander":
            tap.send(*THEIRS)
            until(lambda: not control(platform).ok)
        else:
            simulator.inject("remote")
            until(lambda: platform.state().mode == "remote control")
        tap.frames()
        platform.disengage()
        platform.close()
        assert tap.commands() == []


def test_the_simulated_rival_is_noticed_too():
    with drive() as (platform, simulator):
        platform.engage()
        simulator.order("begin foreign_commands")
        until(lambda: platform.state().stopped, within_s=0.5)
        assert COMMANDS in platform.state().stopped
        assert platform.state().taken_over


def test_a_base_that_somebody_commands_is_not_fit_to_engage_and_is_sent_nothing():
    profile = base_profile()
    with commanding(profile, STILL), tapped(profile) as (platform, _, tap):
        assert COMMANDS in refused(platform)["control"]
        with pytest.raises(PlatformError, match=COMMANDS):
            platform.engage()
        assert {number for number, _ in tap.commands()} == {STILL[0]}
        platform.disengage()


def test_somebody_who_begins_to_command_while_this_side_engages_gets_the_base():
    profile = base_profile("scout", faults=("frozen_feedback",))  # it never says that it obeys
    with tapped(profile) as (platform, _, tap):
        engaging = Engaging(platform)
        engaging.start()
        until(lambda: COMMAND_MODE in tap.commands())
        tap.send(*THEIRS)
        engaging.join()
        assert COMMANDS in engaging.why
        tap.frames()
        platform.disengage()
        assert tap.commands() == []


def test_a_base_that_somebody_else_has_enabled_is_refused_with_what_to_do():
    with tapped() as (platform, simulator, tap):
        tap.send(*COMMAND_MODE)
        until(lambda: "switching it off and on" in control(platform).message)  # once its time-out has passed
        tap.frames()
        with pytest.raises(PlatformError, match="switching it off and on"):
            platform.engage()
        assert tap.commands() == []
        assert simulator.simulator.base.mode == "ours"


def test_a_base_that_this_side_holds_is_engaged_again():
    with drive() as (platform, simulator):
        platform.engage()
        platform.hold("a pause")
        assert simulator.simulator.base.mode == "ours"
        assert refused(platform) == {}
        platform.engage()
        assert platform.state().engaged


def ended_process():
    """The number of a process that is gone."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def leave_mark(profile, pid):
    mark = ChargeMark(profile.connection.robot)
    mark._path.write_text(f"{pid}\n")
    return mark


def test_a_base_that_a_killed_run_left_enabled_is_taken_back_through_standby():
    profile = base_profile()
    with tapped(profile) as (platform, _, tap):
        pid = ended_process()
        mark = leave_mark(profile, pid)
        tap.send(*COMMAND_MODE)
        until(lambda: platform.state().mode == "commanded")
        until(lambda: control(platform).ok)  # whoever enabled it was heard, and must be silent for a while
        assert f"process {pid} left the base enabled" in control(platform).message
        tap.frames()
        platform.engage()
        said = [frame for frame in tap.commands() if frame != STILL]
        assert said == [STANDBY, COMMAND_MODE]
        assert mark.left_by() == os.getpid()
        platform.disengage()
        assert mark.left_by() is None


def test_a_base_that_a_living_process_has_enabled_is_not_taken_back():
    profile = base_profile()
    with tapped(profile) as (platform, _, tap):
        leave_mark(profile, os.getppid())
        tap.send(*COMMAND_MODE)
        until(lambda: platform.state().mode == "commanded")
        with pytest.raises(PlatformError, match=f"{COMMANDS}|enabled already"):
            platform.engage()


def test_a_base_that_was_taken_over_leaves_no_mark():
    profile = base_profile()
    with tapped(profile) as (platform, simulator, _):
        platform.engage()
        simulator.inject("remote")
        until(lambda: platform.state().stopped)
        assert ChargeMark(profile.connection.robot).left_by() is None


def test_one_bus_has_one_adapter_on_a_machine_until_it_is_closed():
    profile = base_profile()
    with drive(profile) as (first, _), WheeledPlatform(profile, first.clock) as second:
        with pytest.raises(PlatformError, match="is driven by another program on this machine"):
            second.connect()
        first.close()
        second.connect()


def test_a_bus_that_cannot_be_opened_is_nobodys():
    profile = base_profile()
    absent = dataclasses.replace(
        profile, connection=dataclasses.replace(profile.connection, interface="socketcan", channel="nocan7")
    )
    for _ in range(2):
        with pytest.raises(PlatformError, match="cannot be opened"):
            WheeledPlatform(absent, MonotonicClock()).connect()


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ({"interface": "socketcan", "channel": "can0"}, {"interface": "socketcan", "channel": "can1"}),
        ({"interface": "socketcand", "port": 1}, {"interface": "socketcand", "port": 2}),
        ({"interface": "socketcand", "host": "a"}, {"interface": "socketcand", "host": "b"}),
        ({"interface": "socketcand", "channel": "can0"}, {"interface": "socketcand", "channel": "can1"}),
        (
            {"interface": "slcan", "channel": "/dev/ttyACM0"},
            {"interface": "slcan", "channel": "/dev/ttyACM1"},
        ),
    ],
)
def test_two_buses_are_two_robots(one, other):
    connection = base_profile().connection
    robots = [dataclasses.replace(connection, **settings).robot for settings in (one, one, other)]
    assert robots[0] == robots[1] != robots[2]


def test_a_device_is_the_same_under_its_other_names(tmp_path):
    device, link = tmp_path / "ttyACM0", tmp_path / "by-id"
    device.touch()
    link.symlink_to(device)
    connection = dataclasses.replace(base_profile().connection, interface="slcan")
    robots = {dataclasses.replace(connection, channel=str(name)).robot for name in (device, link)}
    assert len(robots) == 1


def test_of_two_on_one_bus_without_a_machine_in_common_never_both_drive(monkeypatch):
    monkeypatch.setattr("adatracker_wheeled.adapter.transport.Claim", OfAnotherMachine)
    for delay_ms in (0, 1, 5, 20, 60):
        profile, clock = base_profile(), MonotonicClock()
        with contextlib.ExitStack() as stack:
            sitl = stack.enter_context(InProcess(profile))
            sitl.start(clock, Scenario())
            both = [stack.enter_context(WheeledPlatform(profile, clock)) for _ in range(2)]
            for platform in both:
                platform.connect()
            begin_ns = clock.now_ns() + 50_000_000

            def engage(platform, at_ns):
                platform.clock.sleep_until(at_ns)
                with contextlib.suppress(PlatformError):
                    platform.engage()

            threads = [
                threading.Thread(target=engage, args=(platform, begin_ns + index * delay_ms * 1_000_000))
                for index, platform in enumerate(both)
            ]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            clock.sleep_until(clock.now_ns() + 100_000_000)
            assert sum(platform.state().engaged for platform in both) <= 1


def test_of_two_that_start_at_once_exactly_one_has_the_base(measured, exhaustive):
    profile, clock = base_profile(), MonotonicClock()
    simulator, ended = Simulator(profile.connection.roles, profile.sitl, Scenario(), clock), threading.Event()
    server = SocketcandServer(0, simulator.hear)
    serving = threading.Thread(target=simulator.serve, args=(server.send, ended))
    serving.start()
    try:
        results = race(
            "wheeled",
            {"interface": "socketcand", "port": server.port},
            starts=50 if exhaustive else 5,
        )
    finally:
        ended.set()
        serving.join()
        server.close()
    counts = [len(owners(result)) for result in results]
    measured(
        f"two starts at once for a base, on one machine: {counts.count(1)} of {len(counts)} with one owner"
    )
    assert counts == [1] * len(results), results
    refused = [said for result in results for said in result if said != "owner"]
    assert all("another program on this machine" in said for said in refused)
