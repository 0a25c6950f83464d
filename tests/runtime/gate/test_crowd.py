"""Among people who walk about, the gate keeps a robot from driving into whom its camera shows."""

from __future__ import annotations

import pytest

from benchmarks.crowd import limited, played


@pytest.mark.parametrize("robot", ["wheeled", "quadruped"])
@pytest.mark.parametrize("seed", [1007, 1063, 1092])
def test_who_comes_towards_a_robot_in_full_view_is_not_driven_into(robot, seed):
    assert played(limited(robot, distance=False), seed, seconds=15).touched_s is not None
    assert played(limited(robot), seed, seconds=15).touched_s is None


@pytest.mark.parametrize(
    ("robot", "seed"), [("wheeled", 1005), ("drone", 1007), ("drone", 1055), ("drone", 1099)]
)
def test_a_robot_that_goes_on_after_it_is_told_to_stop_has_slowed_down_before(robot, seed):
    assert played(limited(robot, headway=False), seed, seconds=20).touched_s is not None
    assert played(limited(robot), seed, seconds=20).touched_s is None
