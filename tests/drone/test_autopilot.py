"""PX4's rules, one by one: messages and simulated time in, messages and motion out; no wire, no clock."""

import math

import pytest
from flight import EXACT, LOCAL_NED, STILL, Flight, place, velocity
from pymavlink.dialects.v20 import common as mavlink

from adatracker_drone.protocol.events import number_of
from adatracker_drone.protocol.px4 import Mode, Result
from adatracker_drone.sim.motion import Motion
from adatracker_drone.sim.settings import SitlSettings

# Arming


def test_arming_is_denied_until_the_estimator_is_ready():
    flight = Flight()
    assert flight.arm() is Result.REFUSED_NOW
    assert "Arming denied" in flight.texts()
    flight.run(1.0)
    assert flight.arm() is Result.ACCEPTED


def test_arming_is_denied_on_an_empty_battery():
    flight = Flight(SitlSettings(parameters={}, battery=0.1)).run(1.0)
    assert flight.arm() is Result.REFUSED_NOW


def test_arming_is_denied_in_a_mode_that_needs_sticks_or_set_points():
    flight = Flight().run(1.0)
    for mode in (Mode.MANUAL, Mode.ALTCTL, Mode.POSCTL, Mode.OFFBOARD, Mode.LAND):
        assert flight.switch(mode) is Result.ACCEPTED
        assert flight.arm() is Result.REFUSED_NOW, mode


def test_an_armed_vehicle_that_is_not_flown_disarms_itself():
    flight = Flight().run(1.0)
    flight.arm()
    flight.run(9.8)
    assert flight.commander.armed
    flight.run(0.4)
    assert not flight.commander.armed


def test_disarming_in_the_air_is_denied_and_by_force_it_falls():
    flight = Flight().hover()
    assert flight.disarm() is Result.REFUSED_NOW
    assert flight.commander.armed
    assert flight.disarm(force=True) is Result.ACCEPTED
    flight.run(0.5)
    assert flight.body.velocity.vz < -3.0


@pytest.mark.parametrize("height_m", [2.5, 30.0])
def test_what_has_fallen_lies_still_and_is_told_as_landed(height_m):
    flight = Flight().set("MIS_TAKEOFF_ALT", height_m).hover().run(25.0 if height_m > 3 else 1.0)
    flight.disarm(force=True)
    flight.run(6.0)
    assert flight.body.velocity.is_finite()
    assert abs(flight.body.velocity.vz) < 0.1
    assert flight.autopilot.at_rest


def test_disarming_on_the_ground_is_granted():
    flight = Flight().run(1.0)
    flight.arm()
    assert flight.disarm() is Result.ACCEPTED
    assert not flight.commander.armed


def test_before_anything_is_asked_it_stands_where_and_as_it_was_put():
    demand = Flight().autopilot.step(Motion(heading=1.0, on_gear=True), 0.004)
    assert demand == pytest.approx((0.0, 0.0, 0.0, 0.0), abs=1e-9)


# Takeoff, hold, landing, return


def test_a_takeoff_waits_for_the_motors_then_climbs_to_its_altitude_and_holds():
    flight = Flight().set("MIS_TAKEOFF_ALT", 2.0).run(1.0)
    flight.arm()
    flight.take_off()
    flight.run(3.9)
    assert flight.body.motion.on_gear
    flight.run_until(lambda: flight.mode is Mode.HOLD).run(5.0)
    assert flight.body.pose.z == pytest.approx(2.0, abs=0.15)
    assert math.hypot(flight.body.pose.x, flight.body.pose.y) < 0.2


def test_a_takeoff_to_a_height_above_sea_level_goes_there():
    flight = Flight().run(1.0)
    flight.arm()
    flight.order(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, math.nan, math.nan, math.nan, 488.0 + 4.0)
    flight.run(11.0)
    assert flight.body.pose.z == pytest.approx(4.0, abs=0.2)


def test_landing_touches_down_gently_is_told_and_disarms_by_itself():
    flight = Flight().hover()
    assert flight.order(mavlink.MAV_CMD_NAV_LAND) is Result.ACCEPTED
    flight.run_until(lambda: flight.body.motion.on_gear)
    assert abs(flight.body.velocity.vz) < 1.0
    flight.run_until(lambda: flight.commander.landed)
    landed_s = flight.t_s
    flight.run_until(lambda: not flight.commander.armed)
    assert flight.t_s - landed_s == pytest.approx(2.0, abs=0.2)
    states = [message.landed_state for message in flight.of("EXTENDED_SYS_STATE")]
    assert list(dict.fromkeys(states)) == [
        mavlink.MAV_LANDED_STATE_ON_GROUND,
        mavlink.MAV_LANDED_STATE_TAKEOFF,
        mavlink.MAV_LANDED_STATE_IN_AIR,
        mavlink.MAV_LANDED_STATE_LANDING,
    ]
    assert states[-1] == mavlink.MAV_LANDED_STATE_ON_GROUND
    assert flight.autopilot.at_rest


def test_it_lands_with_the_worst_velocity_bias_too():
    flight = Flight(SitlSettings(velocity_bias_m_s=0.3)).hover()
    flight.order(mavlink.MAV_CMD_NAV_LAND)
    flight.run_until(lambda: flight.autopilot.at_rest)


@pytest.mark.parametrize("fail_safe", [False, True])
def test_landed_out_of_offboard_it_is_in_offboard_again_and_refuses_to_arm_until_it_is_put_into_hold(
    fail_safe,
):
    flight = Flight().set("COM_OBL_RC_ACT", 4).offboard(STILL)
    if not fail_safe:
        flight.order(mavlink.MAV_CMD_NAV_LAND)
    flight.run_until(lambda: flight.autopilot.at_rest).run(1.1)
    assert flight.mode is Mode.OFFBOARD
    assert flight.of("HEARTBEAT")[-1].system_status == mavlink.MAV_STATE_UNINIT
    assert not flight.of("SYS_STATUS")[-1].onboard_control_sensors_health & 0x10000000
    assert flight.arm() is Result.REFUSED_NOW
    assert number_of("check_modes_offboard_signal") in [event.number for event in flight.of("EVENT")]
    flight.switch(Mode.HOLD)
    assert flight.arm() is Result.ACCEPTED


def test_a_pilots_position_mode_outlives_the_landing_too():
    flight = Flight().hover()
    flight.switch(Mode.POSCTL)
    flight.order(mavlink.MAV_CMD_NAV_LAND)
    flight.run_until(lambda: flight.autopilot.at_rest)
    assert flight.mode is Mode.POSCTL


def test_the_thrust_ramps_up_for_three_seconds_in_which_it_counts_as_taking_off_and_cannot_be_disarmed():
    flight = Flight().run(1.0)
    flight.arm()
    flight.take_off()
    flight.run(1.2)
    assert flight.of("EXTENDED_SYS_STATE")[-1].landed_state == mavlink.MAV_LANDED_STATE_TAKEOFF
    assert flight.disarm() is Result.REFUSED_NOW
    began_s = flight.t_s
    flight.run_until(lambda: flight.body.pose.z > 0.1)
    assert 2.0 < flight.t_s - began_s < 4.0


@pytest.mark.parametrize("drift_m", [-0.6, 0.6])
def test_a_take_off_counts_from_the_height_that_is_believed_at_arming(drift_m):
    flight = Flight().set("MIS_TAKEOFF_ALT", 2.0)
    flight.autopilot._estimator._drift_m = drift_m
    flight.run(1.0)
    flight.arm()
    flight.take_off()
    flight.run_until(lambda: flight.mode is Mode.HOLD).run(4.0)
    assert flight.body.pose.z == pytest.approx(2.0, abs=0.3)


def test_told_to_land_while_the_thrust_ramps_up_it_never_leaves_the_ground():
    flight = Flight().run(1.0)
    flight.arm()
    flight.take_off()
    flight.run(3.0)
    flight.order(mavlink.MAV_CMD_NAV_LAND)
    flight.run_until(lambda: flight.autopilot.at_rest)
    assert flight.body.pose.z < 0.05
    assert flight.mode is Mode.HOLD


def test_from_the_order_to_take_off_to_offboard_and_from_land_to_landed_it_takes_as_long_as_a_real_one():
    flight = Flight().set("MIS_TAKEOFF_ALT", 2.0).run(1.0)
    flight.arm()
    flight.take_off()
    began_s = flight.t_s
    flight.run_until(lambda: flight.mode is Mode.HOLD, stream=STILL)
    flight.switch(Mode.OFFBOARD)
    flight.run_until(lambda: flight.mode is Mode.OFFBOARD, stream=STILL)
    assert flight.t_s - began_s == pytest.approx(7.0, abs=1.5)
    flight.order(mavlink.MAV_CMD_NAV_LAND)
    began_s = flight.t_s
    flight.run_until(lambda: flight.body.motion.on_gear)
    touched_s = flight.t_s
    flight.run_until(lambda: flight.commander.landed)
    assert 1.3 < flight.t_s - touched_s < 5.6
    assert 5.0 < flight.t_s - began_s < 10.0


def test_the_estimates_errors_are_those_of_a_real_one():
    flight = Flight(SitlSettings(parameters={}), seed=2).hover()
    speeds, heights = [], []
    for _ in range(600):
        flight.run(0.1)
        truth, told = flight.body.motion, flight.of("LOCAL_POSITION_NED")[-1]
        speeds.append(math.hypot(told.vx - truth.v_north, told.vy - truth.v_east))
        heights.append(abs(told.z - truth.down))
    assert 0.1 < math.sqrt(sum(v * v for v in speeds) / len(speeds)) < 0.4
    assert max(speeds) < 0.9
    assert 0.2 < max(heights) < 0.85


def test_after_a_flight_it_can_fly_again():
    flight = Flight().hover()
    flight.order(mavlink.MAV_CMD_NAV_LAND)
    flight.run_until(lambda: flight.autopilot.at_rest)
    assert flight.mode is Mode.HOLD
    assert flight.arm() is Result.ACCEPTED
    assert flight.take_off() is Result.ACCEPTED
    flight.run_until(lambda: flight.body.pose.z > 1.0)


def test_hold_brakes_and_stays():
    flight = Flight().offboard(velocity(forward=2.0)).run(3.0, stream=velocity(forward=2.0))
    flight.switch(Mode.HOLD)
    flight.run(4.0)
    first = flight.body.pose
    flight.run(4.0)
    assert math.dist((first.x, first.y), (flight.body.pose.x, flight.body.pose.y)) < 0.15


@pytest.mark.parametrize("mode", [Mode.HOLD, Mode.LAND])
@pytest.mark.parametrize("forward", [0.8, 1.5, 2.5])
def test_it_stays_where_it_can_stop(mode, forward):
    """PX4's rule, with MPC_ACC_HOR as it is by default."""
    flight = Flight().set("MIS_TAKEOFF_ALT", 20.0).offboard(velocity(forward=forward))
    flight.run(4.0, stream=velocity(forward=forward))
    speed_m_s, from_m = flight.body.velocity.vx, flight.body.pose.x
    flight.switch(mode)
    flight.run(8.0)
    assert not flight.body.motion.on_gear
    stopped_in_m = speed_m_s * (speed_m_s / (2 * 3.0) + 0.6)
    assert flight.body.pose.x - from_m == pytest.approx(stopped_in_m, abs=0.1)


def test_return_comes_home_and_lands():
    flight = Flight().offboard(velocity(forward=2.0)).run(3.0, stream=velocity(forward=2.0))
    assert flight.body.pose.x > 4.0
    assert flight.order(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) is Result.ACCEPTED
    flight.run_until(lambda: flight.autopilot.at_rest, timeout_s=40)
    assert math.hypot(flight.body.pose.x, flight.body.pose.y) < 0.8


def test_a_fence_that_is_set_is_held():
    flight = Flight().set("GF_MAX_HOR_DIST", 3.0).offboard(velocity(forward=1.0))
    flight.run(8.0, stream=velocity(forward=1.0))
    assert flight.mode is Mode.HOLD
    assert math.hypot(flight.body.pose.x, flight.body.pose.y) < 4.0
    assert "Geofence" in flight.texts()


# Offboard: the switch


def test_offboard_without_set_points_is_denied_in_flight():
    flight = Flight().hover()
    assert flight.switch(Mode.OFFBOARD) is Result.REFUSED_NOW
    assert flight.run(2.0).mode is Mode.HOLD


def test_offboard_begins_only_after_a_second_of_set_points():
    flight = Flight().hover().run(0.1, stream=STILL)
    asked_s = flight.t_s
    assert flight.switch(Mode.OFFBOARD) is Result.ACCEPTED
    flight.run(0.7, stream=STILL)
    assert flight.mode is Mode.HOLD
    flight.run_until(lambda: flight.mode is Mode.OFFBOARD, stream=STILL)
    assert 0.8 < flight.t_s - asked_s < 1.2


def test_set_points_slower_than_two_a_second_prove_nothing():
    flight = Flight().hover().run(2.0, stream=STILL, rate_hz=1.5)
    flight.switch(Mode.OFFBOARD)
    assert flight.run(3.0, stream=STILL, rate_hz=1.5).mode is Mode.HOLD


def test_a_switch_whose_set_points_dry_up_before_it_took_effect_lapses():
    flight = Flight().hover().run(0.1, stream=STILL)
    flight.switch(Mode.OFFBOARD)
    flight.run(2.0)
    assert flight.run(2.0, stream=STILL).mode is Mode.HOLD
    assert not flight.commander.failsafe


def test_a_takeoff_that_finishes_after_the_switch_wins_the_race():
    flight = Flight().run(1.0)
    flight.arm()
    flight.take_off()
    ends_m = flight.autopilot.parameters["MIS_TAKEOFF_ALT"] - flight.autopilot.parameters["NAV_MC_ALT_RAD"]
    flight.run_until(lambda: flight.body.pose.z > ends_m, stream=STILL)
    assert flight.switch(Mode.OFFBOARD) is Result.ACCEPTED
    assert flight.run(0.1, stream=STILL).mode is Mode.OFFBOARD
    assert flight.run(2.0, stream=STILL).mode is Mode.HOLD


# Offboard: what is flown


def test_a_body_velocity_turns_with_the_heading_only():
    flight = Flight().offboard(velocity(forward=1.0, yaw_rate=0.5))
    flight.run(3.0, stream=velocity(forward=1.0, yaw_rate=0.5))
    moving = flight.body.velocity
    assert moving.vx == pytest.approx(1.0, abs=0.1)
    assert abs(moving.vy) < 0.15
    assert moving.yaw_rate == pytest.approx(-0.5, abs=0.05)


def test_a_local_velocity_is_north_east_down():
    north = velocity(1.0, 0.0, -0.5, frame=LOCAL_NED)
    flight = Flight().offboard(north).run(3.0, stream=north)
    assert flight.body.motion.v_north == pytest.approx(1.0, abs=0.1)
    assert flight.body.velocity.vz == pytest.approx(0.5, abs=0.1)


def test_a_position_is_flown_to_and_its_heading_taken():
    there = place(3.0, -2.0, -4.0, heading=0.5)
    flight = Flight().offboard(there).run(10.0, stream=there)
    motion = flight.body.motion
    assert math.dist((motion.north, motion.east, motion.down), (3.0, -2.0, -4.0)) < 0.2
    assert motion.heading == pytest.approx(0.5, abs=0.05)


def test_the_vehicles_own_limits_hold():
    flight = Flight().set("MPC_XY_VEL_MAX", 1.0).set("MC_YAWRATE_MAX", 20.0)
    wild = velocity(forward=1e30, down=1e30, yaw_rate=1e30)
    flight.offboard(STILL)
    flight.run(0.8, stream=wild)
    assert flight.body.velocity.vx < 1.15
    assert flight.body.velocity.vz > -1.7
    assert abs(flight.body.velocity.yaw_rate) < math.radians(25)


def test_flown_by_velocity_alone_it_drifts_as_far_as_its_estimate_is_wrong():
    flight = Flight(SitlSettings(**EXACT | {"velocity_bias_m_s": 0.1}), seed=3).offboard(STILL)
    before = flight.body.pose
    flight.run(10.0, stream=STILL)
    climbed = abs(flight.body.pose.z - before.z)
    assert 0.4 < climbed < 1.3
    told = [m.vz for m in flight.of("LOCAL_POSITION_NED")[-100:]]
    assert abs(sum(told) / len(told)) < 0.03  # and it does not know
