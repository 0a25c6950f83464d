"""The ``roles:`` of a profile: what is missing or contradicts itself is refused in one sentence."""

import pytest
from shipped_roles import BASES, document, limits_of, roles_as_written, roles_of

from adatracker_deploy.config.schema import parse
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.registry import load_profile
from adatracker_wheeled.protocol.codec import Codec
from adatracker_wheeled.protocol.roles import Roles

OUTSIDE_SITL = ("platform", "description", "limits", "camera", "connection")


def refused(written):
    with pytest.raises(UsageError) as caught:
        parse(Roles, written, where="profile")
    return str(caught.value)


@pytest.mark.parametrize(
    ("name", "drive"),
    [
        ("scout", "twist"),
        ("tracer", "twist"),
        ("scout_v1", "twist"),
        ("hunter", "ackermann"),
        ("odrive_diff", "differential"),
    ],
)
def test_what_a_base_takes_follows_from_its_command(name, drive):
    assert roles_of(name).drive == drive


@pytest.mark.parametrize("name", BASES)
def test_a_shipped_profile_loads_and_its_limits_can_be_said(name):
    profile = load_profile(name)
    assert profile.platform == "wheeled"
    Codec(profile.connection.roles).check_limits(profile.limits)


@pytest.mark.parametrize("name", BASES)
def test_no_profile_tells_where_its_camera_is_outside_sitl(name):
    told = {key: value for key, value in document(name).items() if key in OUTSIDE_SITL}
    assert told["camera"].keys() == {"uri", "rate_hz"}
    assert not any(word in str(told) for word in ("fov", "intrinsic", "gain", "up_m", "pitch"))


@pytest.mark.parametrize("name", BASES)
def test_every_base_stops_by_itself_later_than_this_side_gives_up(name):
    timing, limits = roles_of(name).timing, limits_of(name)
    assert timing.command_period_s < limits.command_timeout_s <= timing.base_timeout_s


def test_an_unknown_quantity_is_named_with_those_that_are_known():
    written = roles_as_written()
    written["command"][0]["signals"]["speed"] = "LinearVelocity"
    text = refused(written)
    assert "command: unknown quantity 'speed'" in text
    assert "left_turns_s" in text


def test_a_way_is_no_speed():
    written = roles_as_written()
    written["command"][0]["signals"] = {"left_m": "LinearVelocity", "right_m": "AngularVelocity"}
    assert "unknown quantity 'left_m'" in refused(written)


@pytest.mark.parametrize(
    "quantities",
    [
        {},
        {"vx_m_s": "A"},
        {"yaw_rate_rad_s": "A"},
        {"left_m_s": "A"},
        {"vx_m_s": "A", "yaw_rate_rad_s": "B", "steering_rad": "C"},
        {"left_m_s": "A", "left_turns_s": "B", "right_m_s": "C"},
    ],
)
def test_a_command_must_amount_to_exactly_one_kind_of_motion(quantities):
    written = roles_as_written()
    written["command"][0]["signals"] = quantities
    assert "command: must carry vx_m_s and yaw_rate_rad_s or" in refused(written)


def test_a_base_without_a_command_is_refused():
    assert "it carries nothing" in refused(roles_as_written() | {"command": []})


def test_a_base_without_feedback_is_refused():
    assert "feedback: must carry" in refused(roles_as_written() | {"feedback": []})


def test_one_wheel_is_no_odometry():
    written = roles_as_written()
    del written["odometry"][0]["signals"]["left_m"]
    assert "odometry: must carry left_m and right_m, once; it carries right_m" in refused(written)


def test_wheel_speeds_need_a_track():
    written = roles_as_written("odrive_diff")
    del written["wheels"]
    assert "wheel speeds need wheels: {track_m: ...}" in refused(written)


def test_turns_need_a_radius():
    written = roles_as_written("odrive_diff")
    del written["wheels"]["radius_m"]
    assert "wheel angles need wheels: {track_m: ..., radius_m: ...}" in refused(written)


def test_a_steering_angle_needs_a_wheelbase():
    written = roles_as_written("hunter")
    del written["steering"]
    assert "needs steering: {wheelbase_m: ..., max_angle_rad: ...}" in refused(written)


def test_a_mode_value_has_one_meaning():
    written = roles_as_written("tracer")
    written["state"]["remote"] = [0]
    assert "mode 0 is given two meanings" in refused(written)


def test_a_condition_is_well_or_an_emergency_stop_but_not_both():
    written = roles_as_written()
    written["state"]["emergency_stop"] = [1, 0]
    assert "condition 0 is given two meanings" in refused(written)


def test_an_error_bit_has_one_name():
    written = roles_as_written()
    written["state"]["faults"]["the same again"] = 0
    assert "error bit 0 is given two meanings" in refused(written)


def test_an_error_bit_is_a_fault_or_a_warning():
    written = roles_as_written()
    written["state"]["warnings"] = [0]
    assert "error bit 0 is given two meanings" in refused(written)


def test_a_faults_name_can_be_told_apart_in_a_list():
    written = roles_as_written()
    written["state"]["faults"]["one, two"] = 11
    assert "without a comma" in refused(written)


@pytest.mark.parametrize("key", ["messages", "ours", "ok"])
def test_a_state_needs_a_message_a_mode_of_ours_and_a_condition_that_is_well(key):
    written = roles_as_written()
    written["state"][key] = []
    assert "each need at least one entry" in refused(written)


@pytest.mark.parametrize(
    ("key", "value"), [("command_period_s", 0.19), ("state_period_s", 0.6), ("feedback_period_s", 0.3)]
)
def test_a_period_is_shorter_than_its_time_out(key, value):
    written = roles_as_written()
    written["timing"] |= {"base_timeout_s": 0.15, key: value}
    assert f"{key} must be shorter than" in refused(written)


def test_an_unknown_checksum_is_named_with_those_that_are_known():
    assert "expected one of 'none', 'agilex_v1'" in refused(roles_as_written() | {"checksum": "crc8"})
