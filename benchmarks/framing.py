"""How well a policy frames its target through the gate, with a robot's own body, and what a limit costs it.

python benchmarks/framing.py [RUNS] [--platform NAME] [--profile NAME] [--policy NAME] [--others N] [--seed S]
                             [--late TICKS] [--limit NAME=NUMBER ...]

Rehearsals' body, camera and gate, in the simple room, with true masks that are TICKS of 0.1 s old; a drone
hovers at 2 m. Not in real time, so trials of a minute take seconds, and nothing but the limits differs
between two calls. MR is as in `score`, by the true box; |dy| and |dh| are how far its middle is up or down
from where it began, and its height from what it was, in fractions of the picture.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from statistics import fmean, pstdev
from typing import NamedTuple

from adatracker_deploy.config.profile import Profile
from adatracker_deploy.core.messages import Box, ClassMask, Observation, PlatformState
from adatracker_deploy.learning.embodiment import Hovering
from adatracker_deploy.policy.base import Policy, to_twist
from adatracker_deploy.policy.catalogue import load_policy
from adatracker_deploy.registry import load_platform, load_profile, platform_names
from adatracker_deploy.runtime.gate import GateState, Setpoint, judge
from adatracker_deploy.scoring.metrics import score_boxes
from adatracker_deploy.sim import World
from adatracker_deploy.sim.bodies import GroundBody

RATE_HZ, SLOTS = 10, 5
RADIUS_M, ALTITUDE_M = 0.3, 2.0
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
    limits = replace(
        profile.limits, fence_radius_m=1000.0, altitude_m=None, switched_off=("battery", "position_jumped")
    )
    body = load_platform(profile.platform).body(profile)
    if not isinstance(body, GroundBody):
        body = Hovering(body, ALTITUDE_M)
    world = World("simple_room", seed=seed, others=others)
    body.reset(world.start, seed)
    policy.reset(seed)
    fov_rad = math.radians(profile.sitl.camera.fov_deg)
    state = GateState(armed_ns=0)
    boxes: list[Box | None] = []
    pictures: list[ClassMask] = []
    away, pitch = [], []
    for tick in range(SECONDS * RATE_HZ):
        pictures.append(world.render_mask(body.camera_pose, fov_rad, 48, 64))
        boxes.append(Box.of_mask(pictures[-1]))
        mask = pictures[max(0, tick - late)]
        box = boxes[max(0, tick - late)]
        now_ns = tick * 10**9 // RATE_HZ
        seen = Observation(seq=tick, t_ns=now_ns, mask=mask, box=box, confidence=1.0 if box else 0.0)
        setpoint = Setpoint(
            to_twist(policy.act(seen).values, policy.info.action, limits),
            now_ns,
            target_share=box.area if box else None,
            others_share=seen.others_share,
        )
        for slot in range(1, 1 + SLOTS):
            at_ns = now_ns + slot * 10**9 // RATE_HZ // SLOTS
            told = PlatformState(t_ns=at_ns, engaged=True, pose=body.pose, velocity=body.velocity)
            state, verdict = judge(limits, state, setpoint, told, at_ns)
            body.step(verdict.twist, 1 / RATE_HZ / SLOTS)
            if isinstance(body, GroundBody):
                body.place(world.grounded(body.pose, RADIUS_M))
        world.step(1 / RATE_HZ, body.pose)
        away.append(body.pose.distance_to(*world.target_xy))
        pitch.append(body.camera_pose.pitch)
    seen_boxes = [box for box in boxes if box]
    first = seen_boxes[0]
    return Run(
        score_boxes(boxes).mr,
        fmean(away),
        pstdev(away),
        pstdev(pitch),
        fmean(abs(box.cy - first.cy) for box in seen_boxes),
        fmean(abs(box.h - first.h) for box in seen_boxes),
    )


def limit(text: str) -> tuple[str, float]:
    """Return the name and the number of NAME=NUMBER."""
    name, _, number = text.partition("=")
    return name, float(number)


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
    robot = load_platform(arguments.platform)
    profile = load_profile(arguments.profile or robot.default_profile, robot)
    profile = replace(profile, limits=replace(profile.limits, **dict(arguments.limit)))
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
