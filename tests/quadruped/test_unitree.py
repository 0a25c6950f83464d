"""Unitree's own telemetry, against CDR written by hand, and as a simulated robot tells it."""

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Twist
from adatracker_quadruped.protocol import unitree
from adatracker_quadruped.protocol.keys import Keys
from adatracker_quadruped.protocol.messages import Malformed, Odometry
from adatracker_quadruped.protocol.rehearsal_keys import Fault
from tests.driving import send_for
from tests.quadruped import cdr
from tests.quadruped.rehearsal import connected, goes_wrong, rehearsed, simulator
from tests.quadruped.routers import until
from tests.tiers import EXHAUSTIVE

STATE, LOW = cdr.LAYOUTS["SportModeState"], cdr.LAYOUTS["LowState"]
QUATERNION, GYRO, FORCE, POSITION, VELOCITY, YAW_SPEED = 3, 7, 10, 21, 25, 28
"""Where they begin among the primitives of a SportModeState."""
SOC = 4 + 4 + 1 + 14 + 20 * 12 + 3
singles = st.floats(-50, 50, width=32)


def a_state(**changes):
    values = [0] * len(STATE)
    values[0], values[1], values[QUATERNION] = 12, 34, 1.0
    for place, value in changes.items():
        begin = globals()[place]
        values[begin : begin + len(value)] = value
    return values


@given(
    st.tuples(singles, singles, singles),
    st.tuples(singles, singles, singles),
    singles,
    st.tuples(st.sampled_from("<>"), st.integers(0, 255)),
    st.sampled_from([b"", bytes(280), b"\x7f" * 280]),
)
def test_a_state_tells_place_and_velocity_whatever_pads_it_and_with_a_path_behind_it(
    position, velocity, yaw_speed, wire, path
):
    order, padding = wire
    values = a_state(POSITION=position, VELOCITY=velocity, YAW_SPEED=[yaw_speed])
    told = unitree.decode_sport_mode_state(cdr.encode(STATE, values, order, padding) + path)
    assert told.pose == Pose(*position)
    assert told.velocity == Twist(*velocity, yaw_speed)
    assert told.stamp_ns == 12 * 10**9 + 34


def test_the_attitude_is_a_quaternion_with_w_first():
    half = math.sqrt(0.5)
    payload = cdr.encode(STATE, a_state(QUATERNION=(half, 0, 0, half), GYRO=(0, 0, 0.5), FORCE=(0, 0, 9.81)))
    told, imu = unitree.decode_sport_mode_state(payload), unitree.decode_sport_imu(payload)
    assert (told.pose.roll, told.pose.pitch, told.pose.yaw) == pytest.approx((0, 0, math.pi / 2))
    assert imu.attitude == pytest.approx((0, 0, math.pi / 2))
    assert imu.angular_velocity_rad_s == (0, 0, 0.5)
    assert imu.acceleration_m_s2 == pytest.approx((0, 0, 9.81))


def test_what_the_simulated_robot_encodes_is_read_back():
    sent = Odometry(Pose(1, -2, 0.3, 0.1, -0.2, 3.0), Twist(0.5, -0.25, 0, 0.125), 5 * 10**9 + 7)
    payload = unitree.encode_sport_mode_state(sent)
    got = unitree.decode_sport_mode_state(payload)
    assert dataclasses.astuple(got.pose) == pytest.approx(dataclasses.astuple(sent.pose), abs=1e-6)
    assert (got.velocity, got.stamp_ns) == (sent.velocity, sent.stamp_ns)
    values = cdr.decode(STATE, payload)
    assert values[:2] == [5, 7]
    assert values[POSITION : POSITION + 3] == pytest.approx([1, -2, 0.3])


@pytest.mark.parametrize(
    "changes",
    [
        {"QUATERNION": (0, 0, 0, 0)},
        {"QUATERNION": (math.nan, 0, 0, 1)},
        {"POSITION": (math.nan, 0, 0)},
        {"VELOCITY": (math.inf, 0, 0)},
        {"YAW_SPEED": (1e30,)},
    ],
)
def test_what_no_robot_can_be_is_malformed(changes):
    with pytest.raises(Malformed):
        unitree.decode_sport_mode_state(cdr.encode(STATE, a_state(**changes)))


@given(st.binary(max_size=600))
def test_rubbish_is_malformed_and_nothing_else(payload):
    for decode in (unitree.decode_sport_mode_state, unitree.decode_sport_imu, unitree.decode_low_state):
        with pytest.raises(Malformed):
            decode(b"\0\1\0\0" + payload[:200])


@given(st.integers(0, 100), st.sampled_from("<>"))
def test_a_charge_is_told_in_per_cent(percent, order):
    values = [0] * len(LOW)
    values[SOC] = percent
    assert unitree.decode_low_state(cdr.encode(LOW, values, order)) == percent / 100
    assert cdr.decode(LOW, unitree.encode_low_state(percent / 100))[SOC] == percent


def test_more_than_full_is_malformed():
    values = [0] * len(LOW)
    values[SOC] = 101
    with pytest.raises(Malformed, match="101 %"):
        unitree.decode_low_state(cdr.encode(LOW, values))


def test_the_keys_of_rmw_zenoh_name_unitrees_types():
    keys = Keys(
        rehearsed(
            dialect="rmw_zenoh",
            odometry="sport_mode_state",
            odometry_topic="sportmodestate",
            battery="low_state",
            battery_topic="lf/lowstate",
        ).connection
    )
    assert "/unitree_go::msg::dds_::SportModeState_/RIHS01_" in keys.odometry
    assert keys.battery.startswith("0/lf/lowstate/unitree_go::msg::dds_::LowState_/")


@EXHAUSTIVE
@pytest.mark.slow
def test_a_robot_that_tells_only_unitrees_messages_is_rehearsed():
    telling = rehearsed(
        odometry="sport_mode_state",
        odometry_topic="sportmodestate",
        odometry_velocity="odom",
        battery="low_state",
        battery_topic="lowstate",
        imu_topic="",
    )
    with simulator(telling) as (_, profile), connected(profile) as platform:
        platform.engage()
        began = platform.state().pose
        send_for(platform, Twist(vx=0.5), 1.5)
        state = platform.state()
        assert state.velocity.vx == pytest.approx(0.5, abs=0.15)
        assert 0.3 < began.distance_to(state.pose.x, state.pose.y) < 0.9
        assert 0.2 < state.battery <= 1.0
        platform.disengage()
        goes_wrong(profile, Fault.TIPPED_OVER)

        def refused():
            return [check.name for check in platform.preflight() if check.blocking and not check.ok]

        until(lambda: refused() == ["upright"])
