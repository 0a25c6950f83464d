"""Before its target and among others, the gate keeps a robot from driving into whom its camera shows."""

from __future__ import annotations

import pytest

from adatracker_deploy.core.messages import Twist
from adatracker_deploy.core.task import DESIRED_DISTANCE_M
from adatracker_deploy.registry import load_profile, profile_names
from adatracker_deploy.sim import World
from benchmarks.crowd import kept_apart, played
from benchmarks.gated import RATE_HZ, GatedRobot, limited


@pytest.mark.parametrize("profile", profile_names())
def test_no_robot_that_is_told_to_go_ahead_runs_into_a_target_who_stands_still(profile):
    world = World("simple_room", seed=1, path="still", obstacles=False)
    robot = GatedRobot(load_profile(profile), world, seed=1, late=1)
    limits, fastest_m_s = robot.limits, 0.0
    for tick in range(14 * RATE_HZ):
        yaw_rate = 2.0 * robot.body.pose.bearing_to(*world.target_xy)
        vx = limits.forward_m_s if tick > 4 * RATE_HZ else -limits.backward_m_s  # from afar, at full speed
        robot.drive(Twist(vx=vx, yaw_rate=yaw_rate), robot.look())
        fastest_m_s = max(fastest_m_s, robot.body.velocity.vx)
        assert not robot.collided
    assert fastest_m_s > 0.9 * limits.forward_m_s
    assert robot.body.pose.distance_to(*world.target_xy) < DESIRED_DISTANCE_M


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
