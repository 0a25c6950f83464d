"""The mistakes of the embedded segmenter in rendered worlds in the terms of `sim/noise.py`, and its model's.

python benchmarks/mask_noise.py [WORLDS] [--seed S] [--log FILE]

In each world a camera follows the target by the truth for a minute at 10 Hz, among two others and obstacles
as in the condition `field`, from when the segmenter has the target. Counted are the pictures that show it:

* without it in the mask in runs of up to a second, and longer runs;
* with somebody else in its place;
* edges: mask IoU where it is seen, and the IoU of the same true masks displaced by `ragged_px` 1, 2 and 3;
* false people: connected regions of the class `person` that touch no true person, a picture, and how long a
  picture with any is followed by others.

The noise that `NOISE["embedded"]` makes of the same true masks is counted in the same way, in the line below.
Each world is printed when it is done, and with --log kept in a file from which a later call goes on.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import ClassMask, MaskClass, at_size
from adatracker_deploy.core.task import DESIRED_DISTANCE_M
from adatracker_deploy.perception.jpeg import developed
from adatracker_deploy.perception.segmenters import EMBEDDED, open_segmenter
from adatracker_deploy.perception.target.choice import Choice
from adatracker_deploy.sim import World, scene_names
from adatracker_deploy.sim.noise import NOISE, MaskNoise, NoiseSettings
from adatracker_deploy.sim.studio import Eye
from benchmarks.identity import CAMERA_M, FOV_RAD, RATE_HZ, VISIBLE, following

SECONDS = 60
SIZE = 64
RAGGED_PX = (1, 2, 3)
MIDDLE = Choice(numbers=(0.5, 0.5))


@dataclass(slots=True)
class Mistakes:
    """Counts; runs are in pictures."""

    pictures: int = 0
    missing: list[int] = field(default_factory=list)
    """Runs without the target."""
    wrong: int = 0
    iou: list[float] = field(default_factory=list)
    false_people: int = 0
    false_runs: list[int] = field(default_factory=list)

    def add(self, other: Mistakes) -> None:
        for name, value in asdict(other).items():
            setattr(self, name, getattr(self, name) + value)

    def __str__(self) -> str:
        pictures = max(self.pictures, 1)
        short = [run for run in self.missing if run <= RATE_HZ]
        long_s = " ".join(f"{run / RATE_HZ:.1f}" for run in sorted(self.missing) if run > RATE_HZ)
        return (
            f"{self.pictures} pictures; missing {sum(short) / pictures:.1%} in runs of up to 1 s, "
            f"{_mean(short) / RATE_HZ:.2f} s each; longer runs, s: {long_s or '-'}; "
            f"somebody else {self.wrong / pictures:.1%}; IoU {_mean(self.iou):.3f}; "
            f"false people {self.false_people / pictures:.3f} a picture, "
            f"{_mean(self.false_runs) / RATE_HZ:.2f} s a run"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("worlds", type=int, nargs="?", default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--log", type=Path)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    lines = arguments.log.read_text().splitlines() if arguments.log and arguments.log.exists() else []
    done = {world["seed"]: world for world in map(json.loads, lines)}
    kinds = ("embedded", "its model", *(f"ragged {px}" for px in RAGGED_PX))
    in_all = {kind: Mistakes() for kind in kinds}
    for seed in range(arguments.seed * 10_000, arguments.seed * 10_000 + arguments.worlds):
        if seed not in done:
            played = {kind: asdict(counts) for kind, counts in zip(kinds, play(seed), strict=True)}
            done[seed] = {"seed": seed, **played}
            if arguments.log:
                with arguments.log.open("a") as log:
                    log.write(json.dumps(done[seed]) + "\n")
        for kind in kinds:
            in_all[kind].add(Mistakes(**done[seed][kind]))
        print(f"world {seed}: {Mistakes(**done[seed]['embedded'])}", flush=True)
    for kind, counts in in_all.items():
        print(f"{kind}: {counts}")


def play(seed: int) -> list[Mistakes]:
    """Return what the segmenter, its model and displaced edges alone make of one world."""
    true, seen = looked(seed)
    models = [NOISE["embedded"], *(NoiseSettings(ragged_px=px) for px in RAGGED_PX)]
    noisy = [MaskNoise(settings, seed) for settings in models]
    return [counted(true, seen), *(counted(true, [noise(mask)[0] for mask in true]) for noise in noisy)]


def looked(seed: int) -> tuple[list[ClassMask], list[ClassMask]]:
    """Return the true masks of a world and the seen ones, (64, 64) each."""
    world = World(
        scene_names()[seed % len(scene_names())], seed=seed, path="random_walk", obstacles=True, others=2
    )
    eye, robot = Eye(world, FOV_RAD, seed=seed), world.start
    up_m = float(np.random.default_rng(seed).choice(CAMERA_M))
    segmenter = open_segmenter(EMBEDDED, "person", MIDDLE)[0]
    segmenter.reset()
    true: list[ClassMask] = []
    seen: list[ClassMask] = []
    for step in range(SECONDS * RATE_HZ):
        camera = Pose(
            robot.x, robot.y, robot.z + up_m, pitch=math.atan2(up_m - 0.9, DESIRED_DISTANCE_M), yaw=robot.yaw
        )
        frame = developed(eye.take(step * 10**9 // RATE_HZ, step, robot, camera))
        mask = at_size(segmenter(frame).mask, SIZE, SIZE)
        there = at_size(frame.truth.mask, SIZE, SIZE)
        begun = bool(((mask == MaskClass.TARGET) & (there == MaskClass.TARGET)).any())
        if seen or begun:
            true.append(there)
            seen.append(mask)
            world.step(1 / RATE_HZ, robot)
            robot = following(robot, world)
    return true, seen


def counted(true: list[ClassMask], seen: list[ClassMask]) -> Mistakes:
    """Count the mistakes in the pictures that show the target."""
    shown = [pair for pair in zip(true, seen, strict=True) if np.mean(pair[0] == MaskClass.TARGET) > VISIBLE]
    counts = Mistakes(pictures=len(shown))
    missing, false = [], []
    for there, mask in shown:
        target, taken = there == MaskClass.TARGET, mask == MaskClass.TARGET
        missing.append(not taken.any())
        on_it = int((taken & target).sum())
        if on_it > int((taken & (there == MaskClass.PERSON)).sum()):
            counts.iou.append(on_it / int((taken | target).sum()))
        elif taken.any():
            counts.wrong += 1
        people = (there == MaskClass.PERSON) | target
        count, labels = cv2.connectedComponents((mask == MaskClass.PERSON).astype(np.uint8))
        alone = (count - 1) - len(set(np.unique(labels[people]).tolist()) - {0})
        counts.false_people += alone
        false.append(alone > 0)
    counts.missing, counts.false_runs = runs(missing), runs(false)
    return counts


def runs(flags: Iterable[bool]) -> list[int]:
    """Return the lengths of the runs of true values."""
    found, length = [], 0
    for flag in [*flags, False]:
        if flag:
            length += 1
        elif length:
            found.append(length)
            length = 0
    return found


def _mean(values: list[float] | list[int]) -> float:
    return float(np.mean(values)) if values else 0.0


if __name__ == "__main__":
    main()
