"""Is the world faithful? The published Offline-EVT policy must score in it what its paper reports.

python benchmarks/fidelity.py CHECKPOINT [--episodes 20]

CHECKPOINT is the published state dict. The body is the one it was trained on: a camera at 1.7 m, level and 90
degrees wide; no obstacles, a target that walks at random, 10 Hz, a forward limit of 1.3 times the target's
speed and at least 1 m/s. The yaw limit is open, theirs belongs to their simulator's step; here 120 deg/s.
"""

from __future__ import annotations

import argparse
import math
import statistics
import tempfile
from pathlib import Path

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.learning.export import export_checkpoint
from adatracker_deploy.platform import CameraMount
from adatracker_deploy.policy.base import Policy
from adatracker_deploy.policy.catalogue import load_policy
from adatracker_deploy.sim import World
from adatracker_deploy.sim.bodies import DriveSettings, KinematicBody
from adatracker_deploy.sim.episode import EpisodeResult, run_episode

PUBLISHED_AR = {0.5: 391.0, 1.0: 370.0}
"""Target speed in m/s -> accumulated reward over 500 steps: AdaTracker's Table II, Offline EVT at 1.7 m."""
CAMERA_HEIGHT_M = 1.7
YAW_RATE_RAD_S = math.radians(120.0)
DRAWN_PX = 160
"""The side at which the policy's masks are drawn; rendering at it leaves nothing to resample before."""


def published_policy(checkpoint: Path) -> Policy:
    """Export the published state dict and load the bundle, as a user would."""
    with tempfile.TemporaryDirectory() as folder:
        bundle = Path(folder) / "offline_evt"
        export_checkpoint(checkpoint, bundle)
        return load_policy(str(bundle))


def reference_episode(policy: Policy, target_speed_m_s: float, seed: int) -> EpisodeResult:
    """Run 500 steps on the body that the policy was trained on."""
    forward_m_s = max(1.0, 1.3 * target_speed_m_s)
    drive = DriveSettings(
        camera=CameraMount(up_m=CAMERA_HEIGHT_M, fov_deg=90.0),
        forward_m_s=forward_m_s,
        backward_m_s=forward_m_s,
        yaw_rate_rad_s=YAW_RATE_RAD_S,
    )
    limits = Limits(
        forward_m_s=forward_m_s,
        backward_m_s=forward_m_s,
        yaw_rate_rad_s=YAW_RATE_RAD_S,
        accel_m_s2=50.0,
        yaw_accel_rad_s2=100.0,
    )
    world = World(
        "simple_room", seed=seed, target_speed_m_s=target_speed_m_s, path="random_walk", obstacles=False
    )
    size = (DRAWN_PX, DRAWN_PX)
    return run_episode(world, KinematicBody(drive), policy, limits, steps=500, mask_size=size, seed=seed)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("--episodes", type=int, default=20)
    arguments = parser.parse_args()
    policy = published_policy(arguments.checkpoint)
    print("target m/s    AR (sd)     EL    SR   published AR   difference")
    for speed_m_s, published in PUBLISHED_AR.items():
        episodes = [reference_episode(policy, speed_m_s, seed) for seed in range(arguments.episodes)]
        ar = [episode.ar for episode in episodes]
        mean = statistics.fmean(ar)
        spread = statistics.stdev(ar) if len(ar) > 1 else 0.0
        el = statistics.fmean(episode.el for episode in episodes)
        sr = statistics.fmean(episode.success for episode in episodes)
        print(
            f"{speed_m_s:10.1f}  {mean:5.0f} ({spread:3.0f})  {el:5.0f}  {sr:.2f}  {published:13.0f}"
            f"   {mean / published - 1:+10.1%}",
            flush=True,
        )


if __name__ == "__main__":
    main()
