"""Speed of learning's environment on one core, and of data collection on all.

Run with ``python benchmarks/environment.py [--steps N] [--workers N]``; rates are by processor time, and for
the collection by the clock.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

from adatracker_deploy.learning.conditions import CONDITIONS, HEIGHTS_M, TARGET_SPEEDS_M_S, make_cell
from adatracker_deploy.learning.data.collect import collect
from adatracker_deploy.learning.data.recipe import load_recipe, recipe_names
from adatracker_deploy.learning.data.rollout import Rollout
from adatracker_deploy.learning.seeds import TUNING

STEPS_A_CELL = 100


def environment(condition: str) -> None:
    specs = [
        make_cell(condition, height_m, speed_m_s, TUNING[0])
        for height_m in HEIGHTS_M
        for speed_m_s in TARGET_SPEEDS_M_S
    ]
    begin_s, steps = time.process_time(), 0
    for spec in specs:
        rollout = Rollout(spec, STEPS_A_CELL)
        while not rollout.ended:
            rollout.step(rollout.expert)
        steps += len(rollout)
    rate = steps / (time.process_time() - begin_s)
    print(f"{condition:6s} world, noise, masks and expert: {rate:6.0f} steps/s a core")


def collection(recipe: str, steps: int, workers: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        begin_s = time.monotonic()
        collect(load_recipe(recipe), Path(folder), steps=steps, workers=workers)
        taken_s = time.monotonic() - begin_s
        size = sum(path.stat().st_size for path in Path(folder).iterdir())
    rate = f"{steps / taken_s:6.0f} steps/s, {size / steps:.0f} bytes a step"
    print(f"{recipe:6s} {steps} steps, {workers} workers: {rate}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--steps", type=int, default=40_000)
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    for name in CONDITIONS:
        environment(name)
    for name in recipe_names():
        collection(name, arguments.steps, arguments.workers)
