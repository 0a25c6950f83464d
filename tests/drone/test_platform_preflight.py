"""The drone's preflight refuses or warns of unsafe settings, and names the remedy."""

import dataclasses

import pytest

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.registry import load_profile, profile_dir
from adatracker_drone.adapter.preflight import (
    Parameters,
    envelope_checks,
    failsafe_checks,
    health_checks,
    mode_checks,
)
from adatracker_drone.protocol.connection import Connection, altitude_band

SAFE = Parameters(
    COM_OF_LOSS_T=1.0,
    COM_OBL_RC_ACT=4,
    COM_RC_OVERRIDE=3,
    GF_ACTION=2,
    GF_MAX_HOR_DIST=50.0,
    GF_MAX_VER_DIST=20.0,
    MPC_XY_VEL_MAX=12.0,
    MPC_Z_VEL_MAX_UP=3.0,
    MPC_Z_VEL_MAX_DN=1.5,
    MC_YAWRATE_MAX=200.0,
)
LIMITS = Limits(
    forward_m_s=2.5,
    backward_m_s=1.0,
    vertical_m_s=0.8,
    yaw_rate_rad_s=1.57,
    accel_m_s2=2.5,
    yaw_accel_rad_s2=4.0,
    altitude_m=(1.0, 6.0),
)


def judged(checks):
    return {check.name: check for check in checks}


def failsafes(**changes):
    return judged(failsafe_checks(dataclasses.replace(SAFE, **changes)))


def envelope(**changes):
    return judged(envelope_checks(dataclasses.replace(SAFE, **changes), LIMITS))


def test_a_vehicle_that_is_set_up_well_passes_everything():
    assert all(check.ok for check in (*failsafe_checks(SAFE), *envelope_checks(SAFE, LIMITS)))


@pytest.mark.parametrize("seconds", [None, 0.0, -1.0, 1.5, 60.0])
def test_a_time_out_that_is_off_or_long_blocks(seconds):
    check = failsafes(COM_OF_LOSS_T=seconds)["loss time"]
    assert check.blocking
    assert not check.ok
    assert "COM_OF_LOSS_T" in check.message


@pytest.mark.parametrize("action", [None, 0, 1, 2, 3, 6, 7, 99])
def test_a_loss_action_that_does_not_stop_the_drone_by_itself_blocks_and_names_the_cure(action):
    check = failsafes(COM_OBL_RC_ACT=action)["loss action"]
    assert check.blocking
    assert not check.ok
    assert "4 (land) or 5 (hold)" in check.message


@pytest.mark.parametrize("action", [4, 5])
def test_landing_and_holding_are_the_loss_actions_that_pass(action):
    assert failsafes(COM_OBL_RC_ACT=action)["loss action"].ok


@pytest.mark.parametrize(("value", "ok"), [(None, False), (1, False), (2, True), (3, True)])
def test_sticks_that_do_not_end_offboard_are_warned_of(value, ok):
    check = failsafes(COM_RC_OVERRIDE=value)["pilot override"]
    assert check.ok is ok
    assert not check.blocking


@pytest.mark.parametrize(
    ("name", "value"),
    [("MPC_XY_VEL_MAX", 2.0), ("MPC_Z_VEL_MAX_UP", 0.5), ("MPC_Z_VEL_MAX_DN", 0.5), ("MC_YAWRATE_MAX", 45.0)],
)
def test_limits_beyond_the_autopilots_own_are_warned_of(name, value):
    check = envelope(**{name: value})["speed limits"]
    assert not check.ok
    assert not check.blocking
    assert name in check.message


@pytest.mark.parametrize(
    "change",
    [
        {"GF_MAX_HOR_DIST": 0.0},
        {"GF_MAX_VER_DIST": None},
        {"GF_MAX_VER_DIST": 3.0},
        {"GF_ACTION": 0},
        {"GF_ACTION": 1},
        {"GF_ACTION": None},
    ],
)
def test_a_fence_that_is_off_or_too_low_is_warned_of(change):
    check = envelope(**change)["geofence"]
    assert not check.ok
    assert not check.blocking
    assert next(iter(change)) in check.message


def mode(mode="HOLD", *, armable=True, left_offboard=False, tells_current_mode=True):
    return judged(
        mode_checks(mode, armable=armable, left_offboard=left_offboard, tells_current_mode=tells_current_mode)
    )


def test_a_mode_in_which_the_autopilot_does_not_arm_blocks_and_names_the_cure():
    check = mode("POSCTL", armable=False)["mode"]
    assert check.blocking
    assert not check.ok
    assert "POSCTL: switch it to Hold" in check.message


def test_a_drone_that_was_found_in_offboard_and_put_into_hold_passes_and_says_so():
    check = mode(left_offboard=True)["mode"]
    assert check.ok
    assert "was put into HOLD" in check.message


@pytest.mark.parametrize("tells", [False, True])
def test_an_autopilot_whose_pilot_is_noticed_late_is_warned_of(tells):
    check = mode(tells_current_mode=tells)["takeover"]
    assert check.ok is tells
    assert not check.blocking
    assert ("1 s late" in check.message) is not tells


def health(**changes):
    well = {"unhealthy": (), "armable": True, "complaint": "", "battery": 0.8, "min_battery": 0.3}
    return judged(health_checks(**(well | changes)))


def test_a_vehicle_that_cannot_arm_passes_its_own_words_on():
    check = health(armable=False, complaint="Preflight Fail: compass not calibrated")["armable"]
    assert not check.ok
    assert "compass not calibrated" in check.message


def test_a_missing_sensor_is_named():
    assert "global position" in health(unhealthy=("global position",))["sensors"].message


@pytest.mark.parametrize(
    ("battery", "minimum", "ok"),
    [(0.3, 0.3, True), (0.29, 0.3, False), (None, 0.3, False), (None, 0.0, True)],
)
def test_too_little_or_an_unknown_charge_blocks_unless_none_is_asked_for(battery, minimum, ok):
    assert health(battery=battery, min_battery=minimum)["battery"].ok is ok


def test_a_take_off_outside_the_altitude_band_is_refused():
    assert altitude_band(Connection(takeoff_altitude_m=6.0), LIMITS) == (1.0, 6.0)
    with pytest.raises(UsageError, match=r"takeoff_altitude_m 8 is not inside .* \[1, 6\]"):
        altitude_band(Connection(takeoff_altitude_m=8.0), LIMITS)


def test_a_drone_without_an_altitude_band_is_refused():
    with pytest.raises(UsageError, match="missing key 'altitude_m'"):
        altitude_band(Connection(), dataclasses.replace(LIMITS, altitude_m=None))


def test_the_shipped_profiles_values_reach_the_connection(tmp_path):
    shipped = load_profile("px4_quad")
    assert shipped.connection == Connection(takeoff_altitude_m=shipped.connection.takeoff_altitude_m)
    text = (profile_dir() / "px4_quad.yaml").read_text(encoding="utf-8")
    changed = tmp_path / "mine.yaml"
    changed.write_text(text.replace("connect_timeout_s: 10 ", "connect_timeout_s: 3 "), encoding="utf-8")
    assert load_profile(str(changed)).connection.connect_timeout_s == 3.0
