"""How well a policy frames its target through the gate, with a robot's own body, and what a limit costs it.

python benchmarks/framing.py [RUNS] [--platform NAME] [--profile NAME] [--policy NAME] [--others N] [--seed S]
                             [--late TICKS] [--limit NAME=NUMBER ...]

Rehearsals' body, camera and gate, in the simple room, with true masks that are TICKS of 0.1 s old. Not in
real time, so trials of a minute take seconds, and nothing but the limits differs between two calls. MR is as
in `score`, by the true box; |dy| and |dh| are how far its middle is up or down from where it began, and its
height from what it was, in fractions of the picture.
"""

from __future__ import annotations

import argparse
from statistics import fmean, pstdev
from typing import NamedTuple

from adatracker_deploy.config.profile import Profile
from adatracker_deploy.policy.base import Policy, to_twist
from adatracker_deploy.policy.catalogue import load_policy
from adatracker_deploy.registry import platform_names
from adatracker_deploy.scoring.metrics import score_boxes
from adatracker_deploy.sim import World
from benchmarks.gated import RATE_HZ, GatedRobot, limit, limited

SECONDS = 60


class Run(NamedTuple):
    """How a run went."""

    mr: float
    away_m: float
    """Mean distance from the target, m."""
    spread_m: float
    pitch_rad: float
    """Standard deviation."""
    dy: float
    dh: float


def played(policy: Policy, profile: Profile, seed: int, others: int, late: int) -> Run:
    """Play one run of a minute under a profile's limits."""
    world = World("simple_room", seed=seed, others=others)
    robot = GatedRobot(profile, world, seed, late=late)
    policy.reset(seed)
    away, pitch = [], []
    for _ in range(SECONDS * RATE_HZ):
        seen = robot.look()
        robot.drive(to_twist(policy.act(seen).values, policy.info.action, robot.limits), seen)
        away.append(robot.body.pose.distance_to(*world.target_xy))
        pitch.append(robot.body.camera_pose.pitch)
    boxes = [box for box in robot.boxes if box]
    if not boxes:
        raise SystemExit(f"seed {seed}: the target is in no picture")
    first = boxes[0]
    return Run(
        score_boxes(robot.boxes).mr,
        fmean(away),
        pstdev(away),
        pstdev(pitch),
        fmean(abs(box.cy - first.cy) for box in boxes),
        fmean(abs(box.h - first.h) for box in boxes),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("runs", type=int, nargs="?", default=8)
    parser.add_argument("--platform", choices=platform_names(), default="drone")
    parser.add_argument("--profile", default="")
    parser.add_argument("--policy", default="adatracker")
    parser.add_argument("--others", type=int, default=2)
    parser.add_argument("--seed", type=int, default=9001, help="of the first run; others have the next")
    parser.add_argument("--late", type=int, default=0)
    parser.add_argument("--limit", type=limit, action="append", default=[], metavar="NAME=NUMBER")
    arguments = parser.parse_args()
    profile = limited(arguments.platform, arguments.profile, arguments.limit)
    policy = load_policy(arguments.policy)
    seeds = range(arguments.seed, arguments.seed + arguments.runs)
    runs = [played(policy, profile, seed, arguments.others, arguments.late) for seed in seeds]
    mr, away, spread, pitch, dy, dh = (fmean(column) for column in zip(*runs, strict=True))
    each = " ".join(f"{run.mr:.2f}" for run in runs)
    print(
        f"MR {mr:.3f} ({each}), {away:.2f} m away, spread {spread:.2f}; pitch {pitch:.3f} rad; "
        f"|dy| {dy:.3f}, |dh| {dh:.3f}"
    )


if __name__ == "__main__":
    main()
