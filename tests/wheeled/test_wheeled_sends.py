"""The adapter sends the right frames while engaging, driving, stopping and disabling."""

import math

import can
import pytest
from can.interfaces.virtual import VirtualBus
from wheeled_rig import COMMAND_MODE, STANDBY, STILL, base_profile, drive, tapped, until

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import Twist
from tests.driving import send_for

pytestmark = pytest.mark.slow

AHEAD = Twist(vx=0.5)
BRAKE_RELEASE = (0x131, b"\x00")


def test_engaging_says_zero_then_command_mode_and_clears_no_error():
    with tapped() as (platform, _, tap):
        platform.preflight()
        assert tap.commands() == []
        platform.engage()
        said = tap.commands()
        assert said[:3] == [STILL] * 3
        assert said.count(COMMAND_MODE) == 1
        assert set(said) == {STILL, COMMAND_MODE}


def test_disengaging_says_zero_three_times_then_standby_then_nothing():
    with tapped() as (platform, _, tap):
        platform.engage()
        send_for(platform, AHEAD, 0.3)
        platform.disengage()
        assert tap.commands()[-4:] == [STILL, STILL, STILL, STANDBY]
        platform.disengage()
        platform.close()
        assert tap.commands() == []


def test_closing_an_engaged_base_disables_it():
    with tapped() as (platform, _, tap):
        platform.engage()
        send_for(platform, AHEAD, 0.3)
        platform.close()
        assert tap.commands()[-4:] == [STILL, STILL, STILL, STANDBY]


class Crowded:
    """A virtual bus whose send queue is full for frames of given ids, a given number of times."""

    def __init__(self, monkeypatch):
        self.refusals = {}
        send = VirtualBus.send

        def refuse(bus, message, timeout=None):
            if self.refusals.get(message.arbitration_id):
                self.refusals[message.arbitration_id] -= 1
                raise can.CanOperationError("Transmit buffer full")
            send(bus, message, timeout)

        monkeypatch.setattr(VirtualBus, "send", refuse)


@pytest.fixture
def crowded(monkeypatch):
    return Crowded(monkeypatch)


def test_a_disable_that_finds_the_queue_full_is_asked_for_again(crowded):
    with drive() as (platform, simulator):
        platform.engage()
        crowded.refusals[STANDBY[0]] = 2
        platform.disengage()
        assert crowded.refusals[STANDBY[0]] == 0
        until(lambda: simulator.simulator.base.mode == "standby")


def test_a_base_that_could_not_be_disabled_is_disabled_at_the_close(crowded):
    second_axis = 1 << 5 | 0x07  # the first one's request goes out each time, so that the bus is not lost
    with drive(base_profile("odrive_diff")) as (platform, simulator):
        platform.engage()
        crowded.refusals[second_axis] = 1000
        with pytest.raises(PlatformError, match="took no request to disable"):
            platform.disengage()
        assert simulator.simulator.base.mode == "ours"
        crowded.refusals.clear()
        platform.close()
        until(lambda: simulator.simulator.base.mode == "standby")


def test_holding_says_zero_three_times_20_ms_apart_and_keeps_the_base_enabled():
    with tapped() as (platform, simulator, tap):
        platform.engage()
        send_for(platform, AHEAD, 0.3)
        tap.commands()
        platform.hold("the test says so")
        frames = [frame for frame in tap.frames() if frame.arbitration_id == 0x111]
        assert [bytes(frame.data) for frame in frames[-3:]] == [bytes(8)] * 3
        first, second, third = (frame.timestamp for frame in frames[-3:])
        assert second - first > 0.015
        assert third - second > 0.015
        assert simulator.simulator.base.mode == "ours"


def test_a_hunters_brake_is_released_after_it_is_enabled_and_it_drives_a_curve():
    with tapped(base_profile("hunter")) as (platform, simulator, tap):
        platform.engage()
        said = tap.commands()
        assert said.index(COMMAND_MODE) < said.index(BRAKE_RELEASE)
        sent = platform.send(Twist(vx=0.5, yaw_rate=0.2), platform.clock.now_ns())
        assert sent.vx == 0.5
        assert sent.yaw_rate == pytest.approx(0.2, rel=0.02)
        send_for(platform, Twist(vx=0.5, yaw_rate=0.2), 2.0)
        assert platform.state().velocity.yaw_rate == pytest.approx(0.2, rel=0.05)
        sharp = platform.send(Twist(vx=0.5, yaw_rate=1.5), platform.clock.now_ns())
        assert 0.2 < sharp.yaw_rate < 1.0
        assert simulator.simulator.body.pose.yaw > 0.2


def test_no_byte_of_a_command_that_is_not_finite_reaches_the_wire():
    with tapped() as (platform, _, tap):
        platform.engage()
        tap.commands()
        for axis in ("vx", "vy", "vz", "yaw_rate"):
            for value in (math.nan, math.inf, -math.inf):
                with pytest.raises(PlatformError, match="not finite"):
                    platform.send(Twist(**{axis: value}), platform.clock.now_ns())
        assert set(tap.commands_until_quiet()) <= {STILL}
