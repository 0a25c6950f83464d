"""The simulated autopilot keeps PX4's rules: arming, take-off, OFFBOARD, its loss, landing, parameters."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from adatracker_deploy.errors import UsageError
from adatracker_deploy.geometry import Pose
from adatracker_deploy.platform import Twist
from adatracker_drone.autopilot import Autopilot
from adatracker_drone.body import STEP_S, DroneBody
from adatracker_drone.parameters import PARAMETERS
from adatracker_drone.px4 import Landed, Mode, Result
from adatracker_drone.settings import SitlSettings

PEER = mavlink.MAVLink(None, srcSystem=245, srcComponent=191)
EXACT = {"velocity_bias_m_s": 0.0, "velocity_noise_m_s": 0.0, "position_noise_m": 0.0}


class Flight:
    """An autopilot and its body in lock-step, and what it has said."""

    def __init__(self, speed: float = 1.0, **changed) -> None:
        sitl = SitlSettings(**{**EXACT, **changed})
        self.body = DroneBody(sitl)
        self.body.reset(Pose(yaw=math.pi / 2), seed=1)
        self.autopilot = Autopilot(sitl, seed=1, speed=speed)
        self.now_s = 0.0
        self.said = []

    def ask(self, message):
        """Send a message as a peer would, through its bytes."""
        (received,) = PEER.parse_buffer(message.pack(PEER))
        self.autopilot.receive(received)

    def command(self, number, *params) -> Result:
        params = (*params, *[math.nan] * (7 - len(params)))
        self.ask(mavlink.MAVLink_command_long_message(1, 1, number, 0, *params))
        self.said += self.autopilot.transmit()
        return [m for m in self.said if m.get_type() == "COMMAND_ACK"][-1].result

    def velocity(self, vx=0.0, vy=0.0, vz=0.0, yaw_rate=0.0):
        self.ask(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, mavlink.MAV_FRAME_BODY_NED, 1479, 0, 0, 0, vx, vy, vz, 0, 0, 0, 0, yaw_rate
            )
        )

    def fly(self, seconds, until=lambda _: False, **velocity):
        """Let time pass, renewing a velocity set-point at 20 Hz if one is given."""
        for i in range(round(seconds / STEP_S)):
            if velocity and i % 12 == 0:
                self.velocity(**velocity)
            self.now_s += STEP_S
            demand = self.autopilot.step(self.body.motion, self.now_s)
            self.body.power = self.autopilot.power()
            self.body.step(Twist(demand.forward, -demand.right, -demand.down, -demand.yaw_rate), STEP_S)
            self.said += self.autopilot.transmit()
            if until(self):
                return self
        return self

    @property
    def mode(self) -> Mode:
        return self.autopilot.commander.mode

    def aloft(self):
        """Arm, climb to 2.5 m and hold there."""
        self.fly(1.0)
        assert self.command(400, 1) == Result.ACCEPTED
        assert self.command(22) == Result.ACCEPTED
        self.fly(15, until=lambda f: f.mode is Mode.HOLD)
        return self.fly(3)

    def offboard(self, **velocity):
        self.aloft().fly(1.2, vx=0.0)
        assert self.command(176, 129, 6, 0) == Result.ACCEPTED
        return self.fly(0.1, vx=0.0)

    def texts(self) -> str:
        return "\n".join(m.text for m in self.said if m.get_type() == "STATUSTEXT")


def test_arming_is_denied_until_the_estimator_is_ready():
    flight = Flight(ekf_ready_s=2.0)
    flight.fly(1.0)
    assert flight.command(400, 1) == Result.REFUSED_NOW
    flight.fly(1.1)
    assert flight.command(400, 1) == Result.ACCEPTED
    flight.fly(0.1)
    assert "Arming denied" in flight.texts()


def test_take_off_climbs_and_ends_in_hold_there():
    flight = Flight().aloft()
    assert flight.mode is Mode.HOLD
    assert flight.body.pose.z == pytest.approx(2.5, abs=0.3)
    assert flight.autopilot.commander.landed_state is Landed.IN_AIR


def test_an_armed_drone_that_does_not_take_off_disarms_itself():
    flight = Flight()
    flight.fly(1.0)
    flight.command(400, 1)
    flight.fly(PARAMETERS["COM_DISARM_PRFLT"].default + 0.5)
    assert flight.autopilot.at_rest


def test_disarming_in_the_air_is_denied():
    flight = Flight().aloft()
    assert flight.command(400, 0) == Result.REFUSED_NOW
    assert flight.autopilot.commander.armed


def test_landing_ends_disarmed_on_the_ground():
    flight = Flight().aloft()
    flight.command(21)
    flight.fly(20, until=lambda f: f.autopilot.at_rest)
    assert flight.autopilot.at_rest
    assert flight.body.motion.on_gear


def test_offboard_is_denied_without_a_stream_of_set_points():
    flight = Flight().aloft()
    assert flight.command(176, 129, 6, 0) == Result.REFUSED_NOW
    assert flight.mode is Mode.HOLD


def test_in_offboard_it_flies_the_velocity_that_is_asked_for_in_the_level_body_frame():
    flight = Flight().offboard()
    assert flight.mode is Mode.OFFBOARD
    start = flight.body.pose
    flight.fly(4.0, vx=1.0)
    moved = flight.body.pose
    assert flight.body.velocity.vx == pytest.approx(1.0, abs=0.1)
    assert moved.distance_to(start.x, start.y) > 2.5
    assert abs(start.bearing_to(moved.x, moved.y)) < 0.05


@pytest.mark.parametrize("speed", [1.0, 5.0])
@pytest.mark.parametrize(("action", "mode"), [(0, Mode.POSCTL), (4, Mode.LAND), (5, Mode.HOLD)])
def test_when_set_points_cease_the_fail_safe_acts_after_the_loss_time(speed, action, mode):
    flight = Flight(speed, parameters={"COM_OBL_RC_ACT": float(action)})
    flight.aloft().fly(1.2 * speed, vx=0.0)
    flight.command(176, 129, 6, 0)
    flight.fly(0.5, vx=1.0)
    assert flight.mode is Mode.OFFBOARD
    ceased_s = flight.now_s
    flight.fly(10, until=lambda f: f.mode is not Mode.OFFBOARD)
    assert flight.mode is mode
    assert flight.now_s - ceased_s == pytest.approx(1.0 * speed, abs=0.1)
    assert "Failsafe activated" in flight.texts()


def test_set_points_that_return_after_a_loss_put_it_straight_back_into_offboard():
    flight = Flight(parameters={"COM_OBL_RC_ACT": 5.0}).offboard()
    flight.fly(2.0)
    assert flight.mode is Mode.HOLD
    flight.fly(0.2, vx=0.5)
    assert flight.mode is Mode.OFFBOARD


def test_a_mode_that_the_user_chose_after_a_loss_stays():
    flight = Flight(parameters={"COM_OBL_RC_ACT": 5.0}).offboard()
    flight.fly(2.0)
    flight.command(21)
    flight.fly(0.5, vx=0.5)
    assert flight.mode is Mode.LAND


def test_a_take_off_that_finishes_takes_offboard_away_again():
    flight = Flight()
    flight.fly(1.0)
    flight.command(400, 1)
    flight.command(22)
    flight.fly(15, until=lambda f: f.body.pose.z > 1.75, vx=0.0)
    flight.fly(0.2, vx=0.0)
    assert flight.command(176, 129, 6, 0) == Result.ACCEPTED
    flight.fly(2.0, vx=0.0)
    assert flight.mode is Mode.HOLD


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_velocity_that_is_no_number_is_no_proof_of_life(value):
    flight = Flight(parameters={"COM_OBL_RC_ACT": 4.0}).offboard()
    flight.fly(2.0, vx=value, vy=value, vz=value)
    assert flight.mode is Mode.LAND


def test_flying_by_velocity_alone_drifts_by_the_estimators_bias():
    flight = Flight(velocity_bias_m_s=0.2).offboard()
    before = flight.body.pose.z
    flight.fly(8.0, vx=0.0)
    assert abs(flight.body.pose.z - before) > 0.5


def test_the_geofence_holds_the_drone():
    flight = Flight(parameters={"GF_MAX_HOR_DIST": 3.0}).offboard()
    flight.fly(6.0, vx=1.0)
    assert flight.mode is Mode.HOLD
    assert "Geofence" in flight.texts()


def _parameter(flight, name):
    flight.ask(mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), -1))
    answer = [m for m in flight.autopilot.transmit() if m.get_type() == "PARAM_VALUE"][-1]
    if answer.param_type == mavlink.MAV_PARAM_TYPE_INT32:
        return struct.unpack("<i", struct.pack("<f", answer.param_value))[0]
    return answer.param_value


def test_parameters_are_listed_read_and_set_byte_wise():
    flight = Flight()
    flight.ask(mavlink.MAVLink_param_request_list_message(1, 1))
    listed = [m.param_id for m in flight.autopilot.transmit() if m.get_type() == "PARAM_VALUE"]
    assert sorted(listed) == sorted(PARAMETERS)
    four = struct.unpack("<f", struct.pack("<i", 4))[0]
    flight.ask(mavlink.MAVLink_param_set_message(1, 1, b"COM_OBL_RC_ACT", four, 6))
    assert _parameter(flight, "COM_OBL_RC_ACT") == 4
    flight.ask(mavlink.MAVLink_param_set_message(1, 1, b"COM_OF_LOSS_T", 0.5, 9))
    assert _parameter(flight, "COM_OF_LOSS_T") == 0.5
    flight.ask(mavlink.MAVLink_param_set_message(1, 1, b"COM_OF_LOSS_T", math.nan, 9))
    assert _parameter(flight, "COM_OF_LOSS_T") == 0.5


def test_a_parameter_in_the_settings_that_does_not_exist_is_refused():
    with pytest.raises(UsageError, match="COM_OF_LOST_T"):
        Flight(parameters={"COM_OF_LOST_T": 1.0})


def test_the_streams_have_px4s_onboard_rates():
    flight = Flight()
    flight.fly(10.0)
    counts = {}
    for message in flight.said:
        counts[message.get_type()] = counts.get(message.get_type(), 0) + 1
    for name, rate in (("HEARTBEAT", 1), ("ATTITUDE", 100), ("LOCAL_POSITION_NED", 30), ("SYS_STATUS", 5)):
        assert counts[name] == pytest.approx(10 * rate, rel=0.05, abs=2)
    assert counts["HOME_POSITION"] >= 5


def test_an_interval_that_was_asked_for_is_kept():
    flight = Flight()
    assert flight.command(511, 245, 100_000) == Result.ACCEPTED
    flight.said.clear()
    flight.fly(5.0)
    assert sum(m.get_type() == "EXTENDED_SYS_STATE" for m in flight.said) == pytest.approx(50, abs=2)
    assert flight.command(511, 99_999, 1000) == Result.DENIED
    assert flight.command(12345) == Result.UNSUPPORTED


anything = st.floats(width=32)


@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from([400, 22, 21, 20, 176, 511, 512, 520, 31000]),
    st.lists(anything, min_size=7, max_size=7),
    st.integers(0, 255),
)
def test_no_command_crashes_it_or_lifts_it_off_the_ground(command, params, target):
    flight = HOSTILE
    flight.ask(mavlink.MAVLink_command_long_message(target, 1, command, 0, *params))
    flight.ask(
        mavlink.MAVLink_set_position_target_local_ned_message(
            0, target, 1, 8, 1479, *params, params[0], params[1], params[2], params[3]
        )
    )
    flight.autopilot.step(flight.body.motion, flight.now_s)
    for message in flight.autopilot.transmit():
        assert message.pack(PEER)


HOSTILE = Flight()
