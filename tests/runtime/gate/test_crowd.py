"""Among people who walk about, the gate keeps a robot from driving into whom its camera shows."""

from __future__ import annotations

import pytest

from benchmarks.crowd import kept_apart, played
from benchmarks.gated import limited


@pytest.mark.parametrize("robot", ["wheeled", "quadruped"])
@pytest.mark.parametrize("seed", [1007, 1063, 1092])
def test_who_comes_towards_a_robot_in_full_view_is_not_driven_into(robot, seed):
    assert played(kept_apart(limited(robot), distance=False), seed, seconds=15).touched_s is not None
    assert played(limited(robot), seed, seconds=15).touched_s is None


@pytest.mark.parametrize("seed", [4215, 4217, 4219])
def test_a_robot_that_goes_on_after_it_is_told_to_stop_has_slowed_down_before(seed):
    drone = limited("drone")
    touched = played(kept_apart(drone, headway=False), seed, seconds=20, speed_m_s=1.4)
    assert touched.touched_s is not None
    assert played(drone, seed, seconds=20, speed_m_s=1.4).touched_s is None
