"""The simulated base keeps the rules of a real one: who may drive it, for how long, and what it says."""

import dataclasses
import itertools
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from wheeled_rig import base_profile

from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_wheeled.protocol.codec import Codec
from adatracker_wheeled.protocol.frames import CanFrame
from adatracker_wheeled.sim.faults import FAULTS, INJECTION_ID, injection, parse_injection
from adatracker_wheeled.sim.firmware import Base
from adatracker_wheeled.sim.fuzz import frames
from tests.kept import blocks_in_use

AHEAD = Twist(vx=0.5, yaw_rate=0.2)


class Drive:
    """A base, whoever commands it, and the time."""

    def __init__(self, name="scout", *, speed=1.0, **sitl):
        profile = base_profile(name)
        self.codec = Codec(profile.connection.roles)
        self.base = Base(profile.connection.roles, dataclasses.replace(profile.sitl, **sitl), speed)
        self.now_s = 0.0

    def say(self, frames):
        for frame in frames:
            self.base.receive(frame, self.now_s)
        return self

    def command(self, twist):
        return self.say(self.codec.command(twist)[1])

    def enabled(self):
        return self.say(self.codec.enable()).say(self.codec.release_brake())

    def after(self, seconds):
        self.now_s += seconds
        return self

    @property
    def demand(self):
        return self.base.demand(self.now_s)

    def begin(self, fault):
        return self.say([injection(fault, begin=True)])

    def end(self, fault):
        return self.say([injection(fault, begin=False)])

    def heard(self, seconds=2.0, motion=ZERO, wheels_m=(0.0, 0.0)):
        """Listen for a while; return the readings, each with its time."""
        readings = []
        for _ in range(round(seconds / 0.01)):
            self.now_s += 0.01
            frames = self.base.transmit(motion, wheels_m, self.now_s)
            readings += [(self.now_s, self.codec.parse(frame)) for frame in frames]
        return readings

    def status(self):
        return [reading.status for _, reading in self.heard(0.3) if reading.status][-1]


def test_commands_count_in_command_mode_only():
    drive = Drive().command(AHEAD)
    assert drive.demand == ZERO
    assert drive.status().mode == "standby"
    drive.enabled().command(AHEAD)
    assert drive.demand == AHEAD
    assert drive.status().mode == "ours"
    drive.say(drive.codec.disable())
    assert drive.demand == ZERO
    assert drive.status().mode == "standby"


def test_a_command_of_before_is_forgotten_when_the_mode_changes():
    drive = Drive().enabled().command(AHEAD)
    drive.say(drive.codec.disable()).enabled()
    assert drive.demand == ZERO


@pytest.mark.parametrize("speed", [1.0, 5.0])
def test_without_a_command_for_half_a_second_of_machine_time_it_stops(speed):
    drive = Drive(speed=speed).enabled().command(AHEAD)
    assert drive.after(0.49 * speed).demand == AHEAD
    assert drive.after(0.02 * speed).demand == ZERO
    assert drive.command(AHEAD).demand == AHEAD


def test_the_remote_control_overrides_and_what_it_ends_does_not_come_back():
    drive = Drive().enabled().command(AHEAD).begin("remote")
    assert drive.demand == ZERO
    assert drive.enabled().command(AHEAD).demand == ZERO
    assert drive.status().mode == "remote"
    drive.end("remote")
    assert drive.command(AHEAD).demand == ZERO
    assert drive.status().mode == "standby"


@pytest.mark.parametrize("fault", ["emergency_stop", "fault"])
def test_nothing_moves_while_a_stop_or_a_fault_holds(fault):
    drive = Drive().enabled().command(AHEAD).begin(fault)
    assert drive.demand == ZERO
    assert drive.command(AHEAD).demand == ZERO
    status = drive.status()
    assert status.emergency_stop == (fault == "emergency_stop")
    assert bool(status.fault) == (fault == "fault")
    drive.end(fault)
    assert drive.command(AHEAD).demand == AHEAD


def test_a_hunter_does_not_move_before_its_brake_is_released():
    drive = Drive("hunter")
    drive.say(drive.codec.enable()).command(Twist(vx=0.5))
    assert drive.demand == ZERO
    drive.say(drive.codec.release_brake()).command(Twist(vx=0.5))
    assert drive.demand.vx == 0.5


def test_a_v1_base_obeys_commands_that_carry_their_mode():
    drive = Drive("scout_v1").enabled().command(Twist(vx=0.5))
    assert drive.demand.vx == pytest.approx(0.5, rel=0.02)


def test_two_odrive_axes_are_driven_once_both_have_heard():
    drive = Drive("odrive_diff").enabled()
    left, right = drive.codec.command(AHEAD)[1]
    assert drive.say([left]).demand == ZERO
    assert drive.say([right]).demand.vx == pytest.approx(AHEAD.vx, rel=1e-5)
    assert drive.demand.yaw_rate == pytest.approx(AHEAD.yaw_rate, rel=1e-5)


def test_messages_come_at_their_periods():
    heard = Drive().heard(2.0)
    counts = {
        name: sum(getattr(reading, name) is not None for _, reading in heard)
        for name in ("status", "motion", "wheels_m", "battery")
    }
    assert counts == {"status": 20, "motion": 100, "wheels_m": 100, "battery": 2}


def test_late_messages_are_not_made_up_for():
    drive = Drive()
    drive.heard(0.1)
    drive.after(5.0)
    assert len(drive.base.transmit(ZERO, (0.0, 0.0), drive.now_s)) == 4
    assert drive.base.transmit(ZERO, (0.0, 0.0), drive.now_s) == ()


def test_it_tells_what_its_wheels_do():
    heard = Drive().heard(0.1, motion=AHEAD, wheels_m=(1.5, -2.25))
    assert {reading.motion for _, reading in heard if reading.motion} == {AHEAD}
    assert {reading.wheels_m for _, reading in heard if reading.wheels_m} == {(1.5, -2.25)}


def test_faults_of_the_wire_do_what_they_say():
    assert Drive().begin("silence").heard(1.0) == []
    frozen = Drive().begin("frozen_feedback").heard(1.0)
    assert not [reading for _, reading in frozen if reading.motion or reading.wheels_m]
    assert [reading for _, reading in frozen if reading.status]
    drive = Drive()
    drive.status()
    counts = {r.status.count for _, r in drive.begin("frozen_state").heard(1.0) if r.status}
    assert len(counts) == 1
    (battery,) = {r.battery for _, r in Drive().begin("low_battery").heard(1.5) if r.battery is not None}
    assert battery == 0.05


def test_what_is_wrong_from_the_start_is_wrong_from_the_start():
    drive = Drive(faults=("remote",))
    assert drive.enabled().command(AHEAD).demand == ZERO
    assert drive.status().mode == "remote"


@pytest.mark.parametrize("name", ["scout", "tracer", "hunter", "scout_v1", "odrive_diff"])
@pytest.mark.parametrize("fault", FAULTS)
def test_every_base_has_a_way_to_show_every_fault(name, fault):
    drive = Drive(name).enabled().command(Twist(vx=0.5)).begin(fault)
    heard = drive.heard(1.5)
    if fault in ("remote", "emergency_stop", "fault"):
        status = [reading.status for _, reading in heard if reading.status][-1]
        assert status.mode != "ours" or status.emergency_stop or status.fault
        assert drive.demand == ZERO


@pytest.mark.parametrize("begin", [True, False])
@pytest.mark.parametrize("fault", FAULTS)
def test_injections_are_read_as_written(fault, begin):
    assert parse_injection(injection(fault, begin=begin)) == (fault, begin)


@given(st.binary(max_size=8), st.booleans())
def test_only_a_whole_injection_is_one(data, extended):
    number = INJECTION_ID if extended else INJECTION_ID & 0x7FF
    parsed = parse_injection(CanFrame(number, data, extended))
    assert (parsed is not None) == (extended and len(data) == 2 and data[0] in FAULTS.values())


@pytest.mark.parametrize("name", ["scout", "odrive_diff", "scout_v1"])
def test_a_hundred_thousand_hostile_frames_move_nothing_and_fill_nothing(name):
    noise = random.Random(7)
    drive = Drive(name)
    known = [frame.id for frames in (drive.codec.enable(), drive.codec.command(ZERO)[1]) for frame in frames]
    enables = {(frame.id, frame.data) for frame in drive.codec.enable()}
    drive.heard(0.1)
    before = blocks_in_use()
    for frame in itertools.islice(frames(known, noise), 100_000):
        if (frame.id, frame.data) not in enables:
            drive.base.receive(frame, drive.now_s)
        if drive.base.mode != "ours":
            assert drive.demand == ZERO
    assert blocks_in_use() - before < 10_000
    assert drive.base.malformed > 0
    assert drive.heard(0.2)
