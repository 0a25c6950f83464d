"""Tests beyond the conformance suite: this rover's remote control, its time-out, and who answers."""

import contextlib
import dataclasses
import socket
import threading

import pytest
from adatracker_deploy import ZERO, MonotonicClock, PlatformError, Twist, UsageError, load_profile

from adatracker_rover.platform import RoverPlatform
from adatracker_rover.protocol.connection import Connection
from adatracker_rover.protocol.messages import Ask, Mode, Request, encode_request
from adatracker_rover.sim.firmware import Rover
from adatracker_rover.sim.settings import SitlSettings
from adatracker_rover.sim.sitl import serve


@contextlib.contextmanager
def connected(settings=SitlSettings()):  # noqa: B008 -- frozen
    """Give a rover whose switches the test can reach, and an adapter at the other end of a real socket."""
    clock, ended = MonotonicClock(), threading.Event()
    rover = Rover(settings, seed=0, now_s=clock.now_ns() / 1e9)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
        wire.bind(("127.0.0.1", 0))
        serving = threading.Thread(target=serve, args=(rover, wire, clock, ended))
        serving.start()
        try:
            with RoverPlatform(at(wire.getsockname()[1]), clock) as platform:
                platform.connect()
                yield rover, platform
        finally:
            ended.set()
            serving.join()


def at(port, host="127.0.0.1"):
    profile = load_profile("rover", RoverPlatform)
    return dataclasses.replace(profile, connection=Connection(host=host, port=port))


def wait_until(platform, condition, command=None):
    """Wait until `condition` of the state holds, 2 s at most; meanwhile send `command`, as the link would."""
    clock = platform.clock
    end_ns = clock.now_ns() + 2_000_000_000
    while not condition(platform.state()):
        assert clock.now_ns() < end_ns, platform.state()
        if command is not None:
            platform.send(command, clock.now_ns())
        clock.sleep_until(clock.now_ns() + 20_000_000)


def drive(platform):
    platform.engage()
    wait_until(platform, lambda state: state.velocity.vx > 0.4, Twist(vx=0.5))


def refusals(platform):
    return {check.name: check.message for check in platform.preflight() if not check.ok}


def test_a_person_with_the_remote_control_keeps_the_rover():
    with connected() as (rover, platform):
        drive(platform)
        rover.take_over()
        wait_until(platform, lambda state: state.stopped)
        assert "remote control" in platform.state().stopped
        assert platform.state().taken_over
        platform.hold("too late")
        platform.disengage()
        assert rover.mode is Mode.REMOTE
        assert "remote control" in platform.state().stopped
        assert "REMOTE" in refusals(platform)["remote control"]
        with pytest.raises(PlatformError, match="remote control"):
            platform.engage()


def test_a_rover_that_stopped_by_itself_waits_for_an_explicit_engage():
    with connected(SitlSettings(command_timeout_s=0.1)) as (_, platform):
        platform.engage()
        wait_until(platform, lambda state: state.stopped)
        assert "TIMED_OUT" in platform.state().stopped
        assert platform.state().taken_over
        with pytest.raises(PlatformError, match="TIMED_OUT"):
            platform.send(ZERO, platform.clock.now_ns())
        platform.engage()
        assert platform.state().engaged
        assert not platform.state().taken_over


@pytest.mark.parametrize(("timeout_s", "message"), [(0.0, "it is off: set"), (3.0, "it is 3 s: set")])
def test_a_rover_that_does_not_stop_by_itself_is_not_fit_to_engage(timeout_s, message):
    with connected(SitlSettings(command_timeout_s=timeout_s)) as (_, platform):
        assert message in refusals(platform)["command time-out"]


def test_an_empty_battery_is_not_fit_to_engage():
    with connected(SitlSettings(battery=0.1)) as (_, platform):
        assert refusals(platform) == {"battery": "10% left, 20% needed"}


def test_a_rover_that_is_no_longer_heard_is_driven_no_further():
    with connected() as (_, platform):
        platform.engage()
        later_ns = platform.clock.now_ns() + 400_000_000
        with pytest.raises(PlatformError, match=r"no report from the rover for 0\.[34] s"):
            platform.send(ZERO, later_ns)
        assert not platform.state().engaged


def test_a_rover_that_still_drives_is_engaged_anew_from_a_stop():
    with connected(SitlSettings(command_timeout_s=5.0)) as (_, platform):
        drive(platform)
        with pytest.raises(PlatformError, match="no report"):
            platform.send(ZERO, platform.clock.now_ns() + 400_000_000)
        platform.engage()
        wait_until(platform, lambda state: state.velocity.vx < 0.05)
        assert platform.state().engaged


def test_disengage_returns_when_the_rover_stands():
    with connected(SitlSettings(lag_s=0.2)) as (_, platform):
        drive(platform)
        platform.disengage()
        assert abs(platform.state().velocity.vx) < 0.05


def test_nobody_at_the_port_is_said_within_two_seconds():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
        silent.bind(("127.0.0.1", 0))
        clock = MonotonicClock()
        began_ns = clock.now_ns()
        platform = RoverPlatform(at(silent.getsockname()[1]), clock)
        with pytest.raises(PlatformError, match=r"no rover answers at 127\.0\.0\.1"):
            platform.connect()
        assert clock.now_ns() - began_ns < 2_000_000_000


def test_the_state_is_told_while_a_command_waits_for_its_answer(monkeypatch):
    with connected() as (_, platform):
        platform.engage()
        asked, answered = threading.Event(), threading.Event()

        def send_and_wait(_request):
            asked.set()
            answered.wait(2.0)

        monkeypatch.setattr(platform._wire, "send", send_and_wait)
        sending = threading.Thread(target=platform.send, args=(ZERO, platform.clock.now_ns()))
        sending.start()
        asked.wait()
        assert platform.state().engaged
        assert not answered.is_set()
        answered.set()
        sending.join()
        monkeypatch.undo()


def test_a_host_that_cannot_be_is_named():
    with pytest.raises(UsageError, match=r"connection\.host 'no such host'"):
        RoverPlatform(at(5005, host="no such host"), MonotonicClock()).connect()


def test_what_nobody_enabled_is_moved_neither_by_commands_nor_by_rubbish():
    rover = Rover(SitlSettings(), seed=0, now_s=0.0)
    for data in (encode_request(Request(Ask.DRIVE, Twist(vx=1.0))), b"", b"RQ", bytes(8), b"\xff" * 64):
        rover.receive(data)
        rover.step(0.1)
    assert rover.at_rest
    assert rover.mode is Mode.IDLE
