"""How often a robot touches somebody among people who walk about, with the gate's distance and without it.

python benchmarks/crowd.py [RUNS] [--others N]

A ground robot with a camera at 0.4 m follows the target by the truth, round obstacle-free laps of the simple
room; what it sees of others is the true mask. The gate is the real one, the body does what it is told.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import MaskClass, PlatformState, Twist
from adatracker_deploy.core.task import DESIRED_DISTANCE_M
from adatracker_deploy.runtime.gate import GateState, Setpoint, judge
from adatracker_deploy.sim import World

RATE_HZ, SLOTS = 10, 5
RADIUS_M = 0.3
LIMITS = Limits(
    forward_m_s=1.5,
    backward_m_s=0.5,
    yaw_rate_rad_s=1.2,
    accel_m_s2=2.0,
    yaw_accel_rad_s2=4.0,
    fence_radius_m=1000.0,
    switched_off=("battery",),
)
WITHOUT = replace(LIMITS, switched_off=("battery", "too_close"))


def touched_s(seed: int, limits: Limits, *, others: int = 6, seconds: int = 40) -> float | None:
    """Return when the robot touches somebody or a wall, s; None where it does not."""
    world = World("simple_room", seed=seed, path="s_path", obstacles=False, others=others)
    robot, now_ns = world.start, 0
    state = GateState(armed_ns=now_ns)
    for tick in range(seconds * RATE_HZ):
        mask = world.render_mask(robot @ Pose(z=0.4), math.pi / 2, 48, 64)
        away_m = robot.distance_to(*world.target_xy) - DESIRED_DISTANCE_M
        wanted = Twist(vx=2.0 * away_m, yaw_rate=3.0 * robot.bearing_to(*world.target_xy))
        setpoint = Setpoint(wanted, now_ns, others_share=float((mask == MaskClass.PERSON).mean()))
        for _ in range(SLOTS):
            now_ns += round(1e9 / RATE_HZ / SLOTS)
            told = PlatformState(t_ns=now_ns, engaged=True, pose=robot, velocity=state.last)
            state, verdict = judge(limits, state, setpoint, told, now_ns)
            moved = verdict.twist.vx / RATE_HZ / SLOTS
            robot = robot @ Pose(x=moved, yaw=verdict.twist.yaw_rate / RATE_HZ / SLOTS)
        world.step(1 / RATE_HZ, robot)
        if world.collides(robot.x, robot.y, robot.z, RADIUS_M):
            return tick / RATE_HZ
    return None


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("runs", type=int, nargs="?", default=60)
    parser.add_argument("--others", type=int, default=6)
    arguments = parser.parse_args()
    for name, limits in (("without", WITHOUT), ("with", LIMITS)):
        ends = [touched_s(seed, limits, others=arguments.others) for seed in range(arguments.runs)]
        found = [f"{seed}: {at:.1f} s" for seed, at in enumerate(ends) if at is not None]
        print(f"{name} the distance: {len(found)} of {arguments.runs} touch somebody; {', '.join(found)}")


if __name__ == "__main__":
    main()
