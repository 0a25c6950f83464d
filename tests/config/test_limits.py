"""A profile's limits are range-checked, fit each other, and say what is switched off."""

from __future__ import annotations

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.config.limits import Limits, encloses
from adatracker_deploy.config.schema import parse
from adatracker_deploy.core.errors import UsageError

LEAST = {"forward_m_s": 1, "backward_m_s": 1, "yaw_rate_rad_s": 1, "accel_m_s2": 1, "yaw_accel_rad_s2": 1}
L_SHAPE = ((0.0, 0.0), (4.0, 0.0), (4.0, 1.0), (1.0, 1.0), (1.0, 4.0), (0.0, 4.0))


FENCE = "limits: fence_corners_m: [0, 0], where the robot is engaged, is not inside the polygon"


def limits(**changes):
    return parse(Limits, LEAST | changes, where="limits")


def test_everything_is_on_by_default():
    made = limits()
    assert made.switched_off == ()
    assert (made.fence_corners_m, made.altitude_m) == ((), None)
    assert made.battery_stop < made.battery_warn


@given(st.floats(0.01, 1))
def test_a_cap_takes_its_share_of_every_speed_and_of_nothing_else(share):
    speeds = {
        "forward_m_s": 4,
        "backward_m_s": 0.8,
        "lateral_m_s": 0.5,
        "vertical_m_s": 2,
        "yaw_rate_rad_s": 3,
    }
    made = limits(**speeds, switched_off=["jerk"])
    before, after = dataclasses.asdict(made), dataclasses.asdict(made.capped(share))
    for name in ("forward_m_s", "backward_m_s", "lateral_m_s", "vertical_m_s", "yaw_rate_rad_s"):
        assert after.pop(name) == share * before.pop(name)
    assert after == before


def test_what_fits_is_taken():
    made = limits(
        battery_stop=0.2,
        battery_warn=0.2,
        altitude_m=[1, 6],
        fence_corners_m=[[-1, -1], [0.5, 0], [-1, 1]],
        switched_off=["geofence", "jerk"],
    )
    assert made.altitude_m == (1.0, 6.0)
    assert made.fence_corners_m == ((-1.0, -1.0), (0.5, 0.0), (-1.0, 1.0))
    assert made.switched_off == ("geofence", "jerk")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"jerk_m_s3": 0}, "limits: jerk_m_s3: 0.0 is out of range [0.1, 1000]"),
        ({"yaw_jerk_rad_s3": 1e9}, "limits: yaw_jerk_rad_s3: 1000000000.0 is out of range"),
        ({"ramp_s": 0}, "limits: ramp_s: 0.0 is out of range [0.05, 10]"),
        ({"state_timeout_s": 9}, "limits: state_timeout_s: 9.0 is out of range [0.05, 5]"),
        ({"fence_radius_m": 0}, "limits: fence_radius_m: 0.0 is out of range [1, 10000]"),
        ({"largest_target": 1.0}, "limits: largest_target: 1.0 is out of range [0.01, 0.9]"),
        ({"battery_stop": 0.0}, "limits: battery_stop: 0.0 is out of range [0.01, 1]"),
        ({"battery_warn": 2.0}, "limits: battery_warn: 2.0 is out of range [0.01, 1]"),
        (
            {"battery_warn": 0.1, "battery_stop": 0.2},
            "limits: battery_warn 0.1 is below battery_stop 0.2: the robot would stop before the warning",
        ),
        ({"altitude_m": [6, 1]}, "limits: altitude_m [6, 1]: the lower comes first"),
        ({"altitude_m": [2, 2]}, "limits: altitude_m [2, 2]: the lower comes first"),
        ({"altitude_m": [1]}, "limits: altitude_m: expected 2 values, got 1"),
        ({"altitude_m": [1, 9999]}, "limits: altitude_m: [1]: 9999.0 is out of range"),
        ({"fence_corners_m": [[0, 1e9]]}, "limits: fence_corners_m[0][1]: 1000000000.0 is out of range"),
        ({"fence_corners_m": [[1, 1], [2, 1], [2, 2]]}, FENCE),
        ({"fence_corners_m": [[-1, 0], [1, 0]]}, FENCE),
        ({"switched_off": ["envelope"]}, "limits: switched_off[0]: expected one of 'altitude', 'battery'"),
        ({"switched_of": []}, "limits: unknown key 'switched_of'; did you mean 'switched_off'?"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_place(change, message):
    with pytest.raises(UsageError) as caught:
        limits(**change)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)
    if message.endswith(("polygon", "warning", "first")):
        assert str(caught.value) == message


@pytest.mark.parametrize(
    ("x", "y", "inside"),
    [
        (0.5, 0.5, True),
        (3.9, 0.5, True),
        (0.5, 3.9, True),
        (2.0, 2.0, False),
        (1.1, 1.1, False),
        (4.1, 0.5, False),
        (-0.1, 0.5, False),
        (0.5, -0.1, False),
        (0.5, 4.1, False),
    ],
)
def test_a_polygon_may_have_a_corner_that_points_inwards(x, y, inside):
    assert encloses(L_SHAPE, x, y) is inside
    assert encloses(L_SHAPE[::-1], x, y) is inside


def test_a_point_on_an_edge_that_two_polygons_share_is_in_one_of_them():
    left = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
    right = tuple((x + 1.0, y) for x, y in left)
    above = tuple((x, y + 1.0) for x, y in left)
    assert (encloses(left, 1.0, 0.5), encloses(right, 1.0, 0.5)) == (False, True)
    assert (encloses(left, 0.5, 1.0), encloses(above, 0.5, 1.0)) == (False, True)


def test_a_first_edge_that_slants_counts_once():
    assert encloses(((-2.0, -2.0), (2.0, -1.0), (0.0, 2.0)), -1.0, -1.5)


@given(st.floats(-3, 3), st.floats(-3, 3))
def test_a_slanting_edge_divides_the_plane_where_it_runs(x, y):
    triangle = ((-2.0, -2.0), (2.0, -1.0), (0.0, 2.0))
    sides = [
        (x2 - x1) * (y - y1) - (y2 - y1) * (x - x1)
        for (x1, y1), (x2, y2) in zip(triangle, (*triangle[1:], triangle[0]), strict=True)
    ]
    if min(map(abs, sides)) > 1e-9:  # on an edge either answer will do
        assert encloses(triangle, x, y) is all(side > 0 for side in sides)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
def test_no_polygon_holds_what_is_no_place(value):
    assert not encloses(L_SHAPE, value, 0.5)
    assert not encloses(L_SHAPE, 0.5, value)
