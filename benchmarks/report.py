"""Time and size of the report of a ten-minute trial: 12,000 steps with 640x480 pictures.

Run: python benchmarks/report.py [--trial FOLDER]
"""

from __future__ import annotations

import argparse
import math
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Box, MaskClass, Twist
from adatracker_deploy.core.record import Latency, StepRecord
from adatracker_deploy.trial.folder import FILE_NAME
from adatracker_deploy.trial.step_json import STEP_FORMAT
from adatracker_deploy.trial.trial_file import TrialFile

STEPS = 12_000
WIDTH, HEIGHT = 640, 480


def step(number: int, rng: np.random.Generator) -> StepRecord:
    """A person who walks to and fro and is lost for two seconds in every forty."""
    phase = number / 90
    lost = 0.2 < (number % 800) / 800 < 0.25
    command = Twist(vx=0.5 + 0.4 * math.sin(phase), yaw_rate=0.3 * math.cos(phase / 2))
    noise = rng.normal(0, 0.03, 4)
    return StepRecord(
        step=number,
        t_ns=number * 50_000_000 + int(rng.integers(0, 300_000)),
        frame_seq=number,
        box=None if lost else Box(0.5 + 0.1 * math.sin(phase), 0.5, 0.15 + 0.02 * math.cos(phase), 0.5),
        confidence=0.0 if lost else 0.9,
        action=(command.vx, command.yaw_rate),
        context=tuple(rng.normal(0, 1, 8)),
        command=command,
        sent=Twist(vx=command.vx * 0.98, yaw_rate=command.yaw_rate),
        gate=("acceleration",) if number % 7 == 0 else (),
        mode="CAN",
        pose=Pose(0.01 * number, 0.0, 0.0, 0.0, 0.0, 0.1),
        velocity=Twist(vx=command.vx + noise[0], yaw_rate=command.yaw_rate + noise[1]),
        battery=1.0 - number / 30_000,
        state_age_s=0.02 + abs(noise[2]),
        latency=Latency(
            observation_age_ms=12.0,
            infer_ms=2.0,
            sensor_to_command_ms=float(rng.gamma(6, 4)),
            lateness_ms=0.1,
        ),
        missed_deadlines=number // 3000,
        distance_m=2.5 + math.sin(phase),
        bearing_rad=0.1 * math.cos(phase),
        target_visible=not lost,
        target="lost" if lost else "tracked",
    )


def write_trial(folder: Path) -> None:
    """Write the trial as the writer process would."""
    rng = np.random.default_rng(0)
    about = {"step_format": str(STEP_FORMAT), "platform": "wheeled", "kind": "real", "policy": "adatracker"}
    metadata = {
        "trial": about | {"steps": str(STEPS), "started": "2026-01-01T12:00:00+00:00", "run_clock_ns": "0"},
        "config": {"yaml": "seed: 0\n"},
    }
    coarse = rng.integers(0, 255, (STEPS // 100 + 1, HEIGHT // 16, WIDTH // 16, 3), np.uint8)
    grain = rng.integers(0, 12, (HEIGHT, WIDTH, 3), np.uint8)
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[120:360, 260:380] = MaskClass.TARGET
    with (folder / FILE_NAME).open("wb") as stream:
        trial = TrialFile(stream, metadata)
        for number in range(STEPS + 1):
            smooth = cv2.resize(coarse[number // 100], (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
            picture = cv2.add(np.roll(smooth, number, axis=1), grain)
            wall_ns = 1_767_268_800_000_000_000 + number * 50_000_000
            trial.picture(wall_ns, wall_ns, number, picture, mask)
            trial.step(wall_ns, wall_ns, step(number, rng))
        trial.finish('{"outcome": "completed", "reason": ""}')


def main() -> None:
    """Print seconds and megabytes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trial", type=Path, help="a trial of your own")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        trial = args.trial or Path(made)
        if args.trial is None:
            write_trial(trial)
        page = Path(made) / "report.html"
        began_s = time.perf_counter()
        command = (sys.executable, "-m", "adatracker_deploy", "report", str(trial), "--out", str(page))
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        spent_s = time.perf_counter() - began_s
        log_mb = (trial / FILE_NAME).stat().st_size / 1e6
        print(f"log {log_mb:.0f} MB; report {page.stat().st_size / 1e6:.2f} MB in {spent_s:.1f} s")


if __name__ == "__main__":
    main()
