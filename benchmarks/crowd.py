"""How often a robot touches somebody among people who walk about, with the gate's distance and without it.

python benchmarks/crowd.py [RUNS] [--platform NAME] [--profile NAME] [--others N] [--seed S]

A robot with the body, the camera and the limits of its profile follows the target by the truth, round
obstacle-free laps of the simple room; what it sees of others is the true mask. The gate is the real one, the
body that of rehearsals: it goes on for a while after it was told to stop. A drone hovers at 2 m, at which it
still touches heads.

Three rows: without any distance; with the distance alone, as if the robot stood at once; and with the
headway, which slows it down before. Near: the share of time within a metre of the distance to the target.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from statistics import fmean
from typing import NamedTuple

from adatracker_deploy.config.limits import Dispensable
from adatracker_deploy.config.profile import Profile
from adatracker_deploy.core.messages import MaskClass, PlatformState, Twist
from adatracker_deploy.core.task import DESIRED_DISTANCE_M
from adatracker_deploy.learning.embodiment import Hovering
from adatracker_deploy.registry import load_platform, load_profile, platform_names
from adatracker_deploy.runtime.gate import GateState, Setpoint, judge
from adatracker_deploy.sim import World
from adatracker_deploy.sim.bodies import GroundBody

RATE_HZ, SLOTS = 10, 5
RADIUS_M = 0.3
ALTITUDE_M = 2.0
NO_HEADWAY_S = 0.01
OFF: tuple[Dispensable, ...] = ("battery", "position_jumped")


class Run(NamedTuple):
    """How a run went."""

    touched_s: float | None
    """When the robot touched somebody or a wall; None where it did not."""
    near: float
    """Share of the time until then within a metre of the desired distance, 0 to 1."""


def played(profile: Profile, seed: int, *, others: int = 6, seconds: int = 40) -> Run:
    """Play one run under a profile's limits; it ends when the robot touches anything."""
    limits = replace(profile.limits, fence_radius_m=1000.0, altitude_m=None)
    body = load_platform(profile.platform).body(profile)
    if not isinstance(body, GroundBody):
        body = Hovering(body, ALTITUDE_M)
    world = World("simple_room", seed=seed, path="s_path", obstacles=False, others=others)
    body.reset(world.start, seed)
    fov_rad = math.radians(profile.sitl.camera.fov_deg)
    now_ns, near = 0, 0
    state = GateState(armed_ns=now_ns)
    for tick in range(seconds * RATE_HZ):
        mask = world.render_mask(body.camera_pose, fov_rad, 48, 64)
        away_m = body.pose.distance_to(*world.target_xy) - DESIRED_DISTANCE_M
        near += abs(away_m) < 1
        wanted = Twist(vx=away_m, yaw_rate=3.0 * body.pose.bearing_to(*world.target_xy))
        setpoint = Setpoint(wanted, now_ns, others_share=float((mask == MaskClass.PERSON).mean()))
        for _ in range(SLOTS):
            now_ns += round(1e9 / RATE_HZ / SLOTS)
            told = PlatformState(t_ns=now_ns, engaged=True, pose=body.pose, velocity=body.velocity)
            state, verdict = judge(limits, state, setpoint, told, now_ns)
            body.step(verdict.twist, 1 / RATE_HZ / SLOTS)
            if isinstance(body, GroundBody):
                body.place(world.grounded(body.pose, RADIUS_M))
        world.step(1 / RATE_HZ, body.pose)
        if world.collides(body.pose.x, body.pose.y, body.pose.z, RADIUS_M):
            return Run(tick / RATE_HZ, near / (tick + 1))
    return Run(None, near / (seconds * RATE_HZ))


def limited(platform: str, profile: str = "", *, distance: bool = True, headway: bool = True) -> Profile:
    """Return a robot's profile, with its gate's distance to others or without, and its headway or none."""
    robot = load_platform(platform)
    loaded = load_profile(profile or robot.default_profile, robot)
    off = OFF if distance else (*OFF, "too_close")
    headway_s = loaded.limits.headway_s if headway else NO_HEADWAY_S
    return replace(loaded, limits=replace(loaded.limits, switched_off=off, headway_s=headway_s))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("runs", type=int, nargs="?", default=120)
    parser.add_argument("--platform", choices=platform_names(), default="drone")
    parser.add_argument("--profile", default="")
    parser.add_argument("--others", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0, help="of the first run; the others have the next ones")
    arguments = parser.parse_args()
    for name, parts in (
        ("without a distance", {"distance": False}),
        ("with the distance", {"headway": False}),
        ("and the headway", {}),
    ):
        profile = limited(arguments.platform, arguments.profile, **parts)
        seeds = range(arguments.seed, arguments.seed + arguments.runs)
        runs = [played(profile, seed, others=arguments.others) for seed in seeds]
        ends = zip(seeds, (run.touched_s for run in runs), strict=True)
        found = ", ".join(f"{seed}: {at:.1f} s" for seed, at in ends if at is not None)
        touched = sum(run.touched_s is not None for run in runs)
        near = fmean(run.near for run in runs)
        print(f"{name}: {touched} of {len(runs)} touch somebody, near {near:.2f}; {found}", flush=True)


if __name__ == "__main__":
    main()
