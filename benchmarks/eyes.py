"""The eyes in rendered worlds, where the truth of every pixel is known, beside real footage.

python benchmarks/eyes.py [--data DIR] [--scale] [--quality] [--masks] [--starts] [--target RULE] [--seed S]

DIR is `benchmarks/perception.py`'s. Without it there is no column of real footage.

* scale: the score of a person's best box (IoU > 0.5) by their height in the detector's input, px. Each person
  is looked at with several input sides, so that heights and people are independent.
* quality: recall by height in the picture, the score's distribution, and how the best box jitters about the
  true one: the standard deviation of its centre and of its height, shares of the true height.
* masks: the IoU of what each mask head cuts out of the best box, in a mask of 160 px, rendered people alone.
* starts: whom the shipped segmenter chooses where a trial begins, the target 2.5 m ahead, to within 10
  degrees, and two others about; by a rule, with and without the witness that is asked about people in doubt.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Box, MaskClass
from adatracker_deploy.core.task import DESIRED_DISTANCE_M, FIRST_SIGHT_S
from adatracker_deploy.perception.boxes import overlap
from adatracker_deploy.perception.drawing import MASK_SIZE
from adatracker_deploy.perception.jpeg import developed
from adatracker_deploy.perception.models.nanodet import SCORE, NanoDet
from adatracker_deploy.perception.models.pose import PoseMasks
from adatracker_deploy.perception.models.selfie import SelfieMasks
from adatracker_deploy.perception.roles import MaskHead
from adatracker_deploy.perception.target.choice import Choice
from adatracker_deploy.perception.target.first_sight import LEAST_SCORE
from adatracker_deploy.perception.target_segmenter import TargetSegmenter
from adatracker_deploy.perception.weights import shipped
from adatracker_deploy.sim import World, scene_names
from adatracker_deploy.sim.studio import Eye
from benchmarks.perception import pictures, read_truth

MATCH = 0.5
SIDES = (224, 288, 352, 416, 512, 640)
BIN_PX = 15
FOV_RAD = math.radians(90.0)
AIMED_RAD = math.radians(10.0)
HEIGHTS_M = (0.4, 1.0, 1.7, 3.0)
START_HZ = 20.0


@dataclass(frozen=True, slots=True)
class Shown:
    """A picture, and the corners of somebody whole in it."""

    picture: np.ndarray
    box: np.ndarray
    mask: np.ndarray | None = None
    """True; None on footage."""

    @property
    def tall_px(self) -> float:
        return float(self.box[3] - self.box[1])


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--data", type=Path)
    parser.add_argument("--scale", action="store_true")
    parser.add_argument("--quality", action="store_true")
    parser.add_argument("--masks", action="store_true")
    parser.add_argument("--starts", action="store_true")
    parser.add_argument("--target", type=Choice.read, default=Choice(), metavar="RULE", help="of starts")
    parser.add_argument("--people", type=int, default=400, metavar="N", help="pictures of each kind")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    if arguments.scale or arguments.quality or arguments.masks:
        kinds = {"rendered": list(itertools.islice(rendered(arguments.seed), arguments.people))}
        if arguments.data:
            kinds["PETS09-S2L1"] = list(itertools.islice(filmed(arguments.data), arguments.people))
        if arguments.scale:
            print_scale(kinds)
        if arguments.quality:
            print_quality(kinds)
        if arguments.masks:
            print_masks(kinds["rendered"])
    if arguments.starts:
        print_starts(arguments.people, arguments.seed, arguments.target)


def rendered(seed: int) -> Iterator[Shown]:
    """Everywhere, from every side, walking and standing, at daytimes of all kinds."""
    rng = np.random.default_rng(seed)
    for number in itertools.count():
        scene = scene_names()[number % len(scene_names())]
        world = World(scene, seed=seed * 10_000 + number, obstacles=False)
        for _ in range(6):
            world.step(float(rng.uniform(0.1, 0.5)))
            x, y = world.target_xy
            away, around, up = rng.uniform(1.5, 6.0), rng.uniform(-math.pi, math.pi), rng.choice(HEIGHTS_M)
            camera = Pose(
                x - away * math.cos(around),
                y - away * math.sin(around),
                world.ground_z(x, y) + float(up),
                pitch=math.atan2(up - 0.9, away),
                yaw=around,
            )
            frame = developed(Eye(world, FOV_RAD, seed=number).take(0, 0, camera, camera))
            rows, columns = np.nonzero(frame.truth.mask == MaskClass.TARGET)
            if len(rows) and columns.min() > 0 and rows.min() > 0 and rows.max() < frame.rgb.shape[0] - 1:
                corners = columns.min(), rows.min(), columns.max() + 1, rows.max() + 1
                mask = frame.truth.mask == MaskClass.TARGET
                yield Shown(frame.rgb, np.array(corners, np.float32), mask)


def filmed(data: Path) -> Iterator[Shown]:
    """People who stand free on PETS09-S2L1."""
    truth = read_truth(data / "boxes" / "mot15-PETS09-S2L1" / "gt" / "gt.txt")
    for number, picture in enumerate(pictures(data / "video" / "vtest.avi")):
        if number % 8 or not truth[number]:
            continue
        boxes = np.array(list(truth[number].values()), np.float32)
        shared = overlap(boxes, boxes)
        np.fill_diagonal(shared, 0.0)
        height, width = picture.shape[:2]
        for box in boxes[shared.max(axis=1, initial=0.0) < 0.05]:
            if box[0] > 0 and box[1] > 0 and box[2] < width and box[3] < height:
                yield Shown(picture, box)


def best(detector: NanoDet, shown: Shown, tall: float | None = None) -> tuple[float, np.ndarray | None]:
    """Return the score of the best box of somebody, and the box; 0 and None without one."""
    found = detector(shown.picture, tall)
    if not len(found):
        return 0.0, None
    right = np.flatnonzero(overlap(shown.box[None], found.boxes)[0] > MATCH)
    if not len(right):
        return 0.0, None
    place = right[found.scores[right].argmax()]
    return float(found.scores[place]), found.boxes[place]


def print_scale(kinds: dict[str, list[Shown]]) -> None:
    detectors = {
        side: NanoDet(shipped("nanodet_g_int8.onnx"), ("person",), side=side, score=0.02) for side in SIDES
    }
    scores: dict[str, list[tuple[float, float]]] = {}
    for kind, people in kinds.items():
        scores[kind] = [
            (shown.tall_px * side / max(shown.picture.shape[:2]), best(detector, shown)[0])
            for shown in people
            for side, detector in detectors.items()
        ]
    print("score by height in the input, px: median, share found (score > 0.35), people")
    print("    px  " + "".join(f"{kind:>26}" for kind in kinds))
    for low in range(30, 300, BIN_PX):
        cells = []
        for found in scores.values():
            those = np.array([score for tall, score in found if low <= tall < low + BIN_PX])
            cells.append(
                f"{np.median(those):12.2f}{(those > SCORE).mean():7.0%}{len(those):7d}"
                if len(those) > 4
                else f"{'-':>26}"
            )
        print(f"{low:4d}-{low + BIN_PX:<4d}" + "".join(cells))


def print_quality(kinds: dict[str, list[Shown]]) -> None:
    detector = NanoDet(shipped("nanodet_g_int8.onnx"), ("person",), score=0.2)
    for kind, people in kinds.items():
        for how in ("at 416", "by size"):
            rows = []
            for shown in people:
                share = shown.tall_px / max(shown.picture.shape[:2])
                score, box = best(detector, shown, share if how == "by size" else None)
                off = (math.nan, math.nan) if box is None else _off(box, shown.box)
                rows.append((shown.tall_px, score, *off))
            tall, score, centre, height = np.array(rows).T
            print(f"\n{kind}, {how}: {len(rows)} people")
            for low, high in ((0, 80), (80, 160), (160, 240), (240, 480)):
                those = (tall >= low) & (tall < high)
                if those.sum() > 4:
                    found = (score[those] > SCORE).mean()
                    print(f"  {low:3d} to {high:3d} px: found {found:.0%} of {those.sum()}")
            seen = score > SCORE
            quantiles = " ".join(f"{value:.2f}" for value in np.quantile(score[seen], (0.1, 0.5, 0.9)))
            print(f"  score, p10 p50 p90: {quantiles}")
            aside, tall = np.nanstd(centre[seen]), np.nanstd(height[seen])
            print(f"  jitter of the centre {aside:.3f}, of the height {tall:.3f}")


def mask_iou(head: MaskHead, shown: Shown, box: np.ndarray) -> float:
    """Return the IoU of what a head cuts out of a box with the true mask, in masks of `MASK_SIZE`."""
    size = (MASK_SIZE, MASK_SIZE)
    true = cv2.resize(shown.mask.astype(np.float32), size, interpolation=cv2.INTER_AREA) >= 0.5
    (mask,) = head(shown.picture, box[None], MASK_SIZE)
    return float((mask & true).sum() / (mask | true).sum())


def print_masks(people: list[Shown]) -> None:
    detector = NanoDet(shipped("nanodet_g_int8.onnx"), ("person",), score=0.2)
    selfie = SelfieMasks(shipped("selfie_segmentation.onnx"))
    heads = {"selfie": selfie, "pose": PoseMasks(shipped("pose_landmark_lite.onnx"), selfie)}
    rows = []
    for shown in people:
        _, box = best(detector, shown, shown.tall_px / max(shown.picture.shape[:2]))
        if box is not None:
            rows.append((shown.tall_px, *(mask_iou(head, shown, box) for head in heads.values())))
    tall, *ious = np.array(rows).T
    print("\nmask IoU by height, px         " + "".join(f"{name:>8}" for name in heads) + "  people")
    for low, high in ((0, 80), (80, 160), (160, 240), (240, 480), (0, 480)):
        those = (tall >= low) & (tall < high)
        if those.sum() > 4:
            print(
                f"  {low:3d} to {high:3d}"
                + " " * 20
                + "".join(f"{iou[those].mean():8.3f}" for iou in ious)
                + f"{those.sum():8d}"
            )


def print_starts(count: int, seed: int, target: Choice) -> None:
    heads = PoseMasks(shipped("pose_landmark_lite.onnx"), SelfieMasks(shipped("selfie_segmentation.onnx")))
    detector = NanoDet(shipped("nanodet_g_int8.onnx"), ("person",), score=LEAST_SCORE)
    for witness in (None, heads):
        segmenter = TargetSegmenter(detector, None, target, least_score=SCORE, witness=witness)
        starts = [started(segmenter, seed * 10_000 + number, number) for number in range(count)]
        right, after_s = zip(*starts, strict=True)
        print(
            f"{count} starts {'with' if witness else 'without'} the witness: {right.count(True)} with the "
            f"target, {right.count(False)} with somebody else, {right.count(None)} with nobody; after "
            "{:.2f} s in the middle, {:.2f} s in 19 of 20".format(*np.quantile(after_s, (0.5, 0.95)))
        )


def started(segmenter: TargetSegmenter, seed: int, number: int) -> tuple[bool | None, float]:
    """Return whether the target is chosen, None if nobody is, and after how long, s."""
    world = World(scene_names()[number % len(scene_names())], seed=seed, others=2)
    eye = Eye(world, FOV_RAD, seed=seed)
    start, up = world.start, HEIGHTS_M[number % len(HEIGHTS_M)]
    pitch = max(0.0, math.atan2(up - 0.9, DESIRED_DISTANCE_M))
    off = float(np.random.default_rng(seed).uniform(-AIMED_RAD, AIMED_RAD))
    camera = Pose(start.x, start.y, start.z + up, pitch=pitch, yaw=start.yaw + off)
    segmenter.reset()
    for picture in range(round(FIRST_SIGHT_S * START_HZ)):
        t_ns = round(picture / START_HZ * 1e9)
        frame = developed(eye.take(t_ns, picture, start, camera))
        seen = segmenter(frame)
        if seen.box is not None:
            true = Box.of_mask(frame.truth.mask)
            shared = 0.0 if true is None else true.iou(seen.box)
            return shared > MATCH, t_ns / 1e9
    return None, FIRST_SIGHT_S


def _off(found: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Return by how much a box is off: its centre aside, and its height, shares of the true height."""
    tall = float(true[3] - true[1])
    return (
        float(found[0] + found[2] - true[0] - true[2]) / 2 / tall,
        (float(found[3] - found[1]) - tall) / tall,
    )


if __name__ == "__main__":
    main()
