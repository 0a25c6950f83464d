"""How often a robot touches somebody among people who walk about, with the gate's distance and without it.

python benchmarks/crowd.py [RUNS] [--platform NAME] [--profile NAME] [--others N] [--seed S] [--late TICKS]
                           [--speed M_S] [--limit NAME=NUMBER ...]

A robot with the body, the camera and the limits of its profile follows the target by the truth, round
obstacle-free laps of the simple room; what its gate sees of others is the true mask, TICKS of 0.1 s old. The
gate is the real one, the body that of rehearsals: it goes on for a while after it was told to stop. A drone
hovers at the height of heads.

Three rows: without any distance; with the distance alone, as if the robot obeyed at once; and with the
headway, which slows it down before. Near: the share of time within a metre of the distance to the target.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from statistics import fmean
from typing import NamedTuple

from adatracker_deploy.config.profile import Profile
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.core.task import DESIRED_DISTANCE_M
from adatracker_deploy.registry import platform_names
from adatracker_deploy.sim import World
from benchmarks.gated import RATE_HZ, GatedRobot, limit, limited

NO_HEADWAY_S = 0.01


class Run(NamedTuple):
    """How a run went."""

    touched_s: float | None
    """When the robot touched somebody or a wall; None where it did not."""
    near: float
    """Share of the time until then within a metre of the desired distance, 0 to 1."""


def played(
    profile: Profile, seed: int, *, others: int = 6, seconds: int = 40, late: int = 1, speed_m_s: float = 1.0
) -> Run:
    """Play one run under a profile's limits, among people who walk at this speed; it ends when the robot
    touches anything."""
    world = World(
        "simple_room", seed=seed, target_speed_m_s=speed_m_s, path="s_path", obstacles=False, others=others
    )
    robot, near = GatedRobot(profile, world, seed, late=late), 0
    for tick in range(seconds * RATE_HZ):
        seen, pose = robot.look(), robot.body.pose
        away_m = pose.distance_to(*world.target_xy) - DESIRED_DISTANCE_M
        near += abs(away_m) < 1
        robot.drive(Twist(vx=away_m, yaw_rate=3.0 * pose.bearing_to(*world.target_xy)), seen)
        if robot.collided:
            return Run(tick / RATE_HZ, near / (tick + 1))
    return Run(None, near / (seconds * RATE_HZ))


def kept_apart(profile: Profile, *, distance: bool = True, headway: bool = True) -> Profile:
    """Return a profile with its gate's distance to others or without, and its headway or none."""
    limits = profile.limits
    if not distance:
        limits = replace(limits, switched_off=(*limits.switched_off, "too_close"))
    if not headway:
        limits = replace(limits, headway_s=NO_HEADWAY_S)
    return replace(profile, limits=limits)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("runs", type=int, nargs="?", default=120)
    parser.add_argument("--platform", choices=platform_names(), default="drone")
    parser.add_argument("--profile", default="")
    parser.add_argument("--others", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0, help="of the first run; the others have the next ones")
    parser.add_argument("--late", type=int, default=1)
    parser.add_argument("--speed", type=float, default=1.0, help="of everybody, m/s")
    parser.add_argument("--limit", type=limit, action="append", default=[], metavar="NAME=NUMBER")
    arguments = parser.parse_args()
    usual = limited(arguments.platform, arguments.profile, arguments.limit)
    for name, profile in (
        ("without a distance", kept_apart(usual, distance=False)),
        ("with the distance", kept_apart(usual, headway=False)),
        ("and the headway", usual),
    ):
        seeds = range(arguments.seed, arguments.seed + arguments.runs)
        people = {"others": arguments.others, "late": arguments.late, "speed_m_s": arguments.speed}
        runs = [played(profile, seed, **people) for seed in seeds]
        ends = zip(seeds, (run.touched_s for run in runs), strict=True)
        found = ", ".join(f"{seed}: {at:.1f} s" for seed, at in ends if at is not None)
        touched = sum(run.touched_s is not None for run in runs)
        near = fmean(run.near for run in runs)
        print(f"{name}: {touched} of {len(runs)} touch somebody, near {near:.2f}; {found}", flush=True)


if __name__ == "__main__":
    main()
