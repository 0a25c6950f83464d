"""Scoring an hour of trials at 20 Hz: logs with pictures, masks, boxes and poses, by the real command.

python benchmarks/scoring.py [--trials 12] [--steps 6000]

One trial is written, and linked as many times as there are trials: reading is timed from memory, not
from a disk. Pictures are small (160x120); larger ones are stepped over all the same.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import tempfile
import time
from pathlib import Path

import numpy as np

from adatracker_deploy.cli import main as command
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Box, Twist
from adatracker_deploy.core.record import Latency, StepRecord
from adatracker_deploy.trial.folder import FILE_NAME
from adatracker_deploy.trial.step_json import STEP_FORMAT
from adatracker_deploy.trial.trial_file import TrialFile

RATE_HZ = 20.0
ROUNDS = 5


def main() -> None:
    arguments = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    arguments.add_argument("--trials", type=int, default=12)
    arguments.add_argument("--steps", type=int, default=6000)
    options = arguments.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        first = folder / "0" / FILE_NAME
        first.parent.mkdir()
        write_trial(first, options.steps)
        for number in range(1, options.trials):
            (folder / str(number)).mkdir()
            os.link(first, folder / str(number) / FILE_NAME)
        wall_s, cpu_s = zip(*(timed(["score", name, "--json"]) for _ in range(ROUNDS)), strict=True)
        steps = options.trials * options.steps
        print(
            f"{options.trials} trials, {steps} steps, {steps / RATE_HZ / 60:.0f} min, "
            f"{options.trials * first.stat().st_size / 1e6:.0f} MB"
        )
        print(f"scored in {min(wall_s):.2f} s, CPU {min(cpu_s):.2f} s (best of {ROUNDS})")


def timed(argv: list[str]) -> tuple[float, float]:
    """Run a command without its output; return wall-clock and processor time, s."""
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    with contextlib.redirect_stdout(io.StringIO()):
        if command(argv) != 0:
            raise SystemExit("could not be scored")
    return time.perf_counter() - wall_s, time.process_time() - cpu_s


def write_trial(path: Path, steps: int) -> None:
    rng = np.random.default_rng(0)
    rgb = rng.integers(0, 255, (120, 160, 3)).astype(np.uint8)
    mask = np.zeros((120, 160), np.uint8)
    mask[20:100, 60:90] = 1
    about = {"step_format": str(STEP_FORMAT), "platform": "drone", "kind": "sitl", "policy": "none"}
    metadata = {"trial": {**about, "steps": str(steps)}, "config": {"yaml": "seed: 0\n"}}
    with path.open("wb") as stream:
        file = TrialFile(stream, metadata)
        for step in range(steps + 1):
            t_ns = round(step * 1e9 / RATE_HZ)
            file.picture(t_ns, t_ns, step, rgb, mask)
            file.step(t_ns, t_ns, a_tick(step, t_ns, rng))
        file.finish('{"outcome": "completed"}')


def a_tick(step: int, t_ns: int, rng: np.random.Generator) -> StepRecord:
    numbers = iter(rng.normal(0, 0.05, 40).tolist())
    return StepRecord(
        step=step,
        t_ns=t_ns,
        frame_seq=step,
        box=Box(0.5 + next(numbers), 0.5 + next(numbers), 0.2, 0.5) if step % 20 else None,
        confidence=0.9,
        action=(next(numbers), next(numbers)),
        context=tuple(next(numbers) for _ in range(16)),
        command=Twist(vx=next(numbers), yaw_rate=next(numbers)),
        sent=Twist(vx=next(numbers), yaw_rate=next(numbers)),
        gate=(),
        mode="OFFBOARD",
        pose=Pose(*(next(numbers) for _ in range(6))),
        velocity=Twist(vx=next(numbers), yaw_rate=next(numbers)),
        battery=0.8,
        state_age_s=0.02,
        latency=Latency(observation_age_ms=12, infer_ms=2, sensor_to_command_ms=15, lateness_ms=0.1),
        missed_deadlines=0,
        distance_m=2.5 + next(numbers),
        bearing_rad=next(numbers),
        target_visible=True,
    )


if __name__ == "__main__":
    main()
