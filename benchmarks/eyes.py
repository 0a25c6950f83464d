"""The eyes in rendered worlds, where the truth of every pixel is known, beside real footage.

python benchmarks/eyes.py [--data DIR] [--scale] [--quality] [--identity CROSSINGS] [--seed S]

DIR is `benchmarks/perception.py`'s. Without it there is no column of real footage.

* scale: the score of a person's best box (IoU > 0.5) by their height in the detector's input, px. Each person
  is looked at with several input sides, so that heights and people are independent.
* quality: recall by height in the picture, the score's distribution, and how the best box jitters about the
  true one: the standard deviation of its centre and of its height, shares of the true height.
* identity: a target and others walk about, some in the target's own clothes; a camera follows the target by
  the truth, and the segmenter is told nothing but the pictures. A crossing: somebody nearer to the camera
  overlaps the target from side to side, until nobody has for half a second. Wrong: two seconds later the
  segmenter has somebody else. Found again: within two seconds it has had the target.
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
from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.core.sight import Verdict, judged
from adatracker_deploy.core.task import DESIRED_DISTANCE_M
from adatracker_deploy.perception.boxes import overlap
from adatracker_deploy.perception.jpeg import developed
from adatracker_deploy.perception.models.nanodet import SCORE, NanoDet
from adatracker_deploy.perception.segmenters import EMBEDDED, open_segmenter
from adatracker_deploy.perception.target.choice import Choice
from adatracker_deploy.perception.weights import shipped
from adatracker_deploy.sim import World, scene_names
from adatracker_deploy.sim.render.figure import shipped_people
from adatracker_deploy.sim.studio import Eye
from benchmarks.perception import pictures, read_truth

MATCH = 0.5
SIDES = (224, 288, 352, 416, 512, 640)
BIN_PX = 15
FOV_RAD = math.radians(90.0)
RATE_HZ = 10.0
AFTER_S = 2.0
APART_S = 0.5
SHOULDERS_M = 0.5
HEIGHTS_M = (0.4, 1.0, 1.7, 3.0)


@dataclass(frozen=True, slots=True)
class Shown:
    """A picture, and the corners of somebody whole in it."""

    picture: np.ndarray
    box: np.ndarray

    @property
    def tall_px(self) -> float:
        return float(self.box[3] - self.box[1])


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--data", type=Path)
    parser.add_argument("--scale", action="store_true")
    parser.add_argument("--quality", action="store_true")
    parser.add_argument("--identity", type=int, default=0, metavar="CROSSINGS")
    parser.add_argument("--people", type=int, default=400, metavar="N", help="pictures of each kind")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    if arguments.scale or arguments.quality:
        kinds = {"rendered": list(itertools.islice(rendered(arguments.seed), arguments.people))}
        if arguments.data:
            kinds["PETS09-S2L1"] = list(itertools.islice(filmed(arguments.data), arguments.people))
        if arguments.scale:
            print_scale(kinds)
        if arguments.quality:
            print_quality(kinds)
    if arguments.identity:
        print_identity(arguments.identity, arguments.seed)


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
                yield Shown(frame.rgb, np.array(corners, np.float32))


def filmed(data: Path) -> Iterator[Shown]:
    """Whoever stands free on PETS09-S2L1."""
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


def _off(found: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Return by how much a box is off: its centre aside, and its height, shares of the true height."""
    tall = float(true[3] - true[1])
    return (
        float(found[0] + found[2] - true[0] - true[2]) / 2 / tall,
        (float(found[3] - found[1]) - tall) / tall,
    )


def print_identity(wanted: int, seed: int) -> None:
    crossings = wrong = again = pictures_seen = 0
    delays = []
    for number in itertools.count():
        for alike in (False, True):
            found = crossed(seed * 10_000 + number, alike=alike)
            crossings += len(found)
            wrong += sum(each.wrong for each in found)
            again += sum(each.found_s <= AFTER_S for each in found)
            delays += [each.found_s for each in found if each.found_s <= AFTER_S]
        if crossings >= wanted:
            break
    print(
        f"{crossings} crossings: somebody else {wrong / crossings:.2%}, found again within {AFTER_S:g} s "
        f"{again / crossings:.1%}, after {np.median(delays):.2f} s in the middle; {pictures_seen or ''}"
    )


@dataclass(slots=True)
class Crossing:
    """One, from its end on."""

    end_s: float
    found_s: float = math.inf
    wrong: bool = False


def crossed(seed: int, *, alike: bool, seconds: float = 60.0) -> list[Crossing]:
    """Play a world; return its crossings whose two seconds are over."""
    rng = np.random.default_rng(seed)
    people = shipped_people()
    target, likest = rng.permutation(len(people))[:2]
    cast = (people[target], people[target if alike and rng.random() < 0.5 else likest])
    world = World(
        scene_names()[seed % len(scene_names())],
        seed=seed,
        path="random_walk",
        others=4,
        crossing=3,
        cast=cast,
    )
    segmenter = open_segmenter(EMBEDDED, "person", Choice())[0]
    segmenter.reset()
    eye = Eye(world, FOV_RAD, seed=seed)
    up_m, chosen = float(rng.choice(HEIGHTS_M[:3])), False
    robot = world.start
    crossings: list[Crossing] = []
    near_since_s = -math.inf
    ended = True
    for step in range(round(seconds * RATE_HZ)):
        now_s = step / RATE_HZ
        if chosen:
            world.step(1 / RATE_HZ, robot)
            robot = following(robot, world)
        camera = Pose(
            robot.x, robot.y, robot.z + up_m, pitch=math.atan2(up_m - 0.9, DESIRED_DISTANCE_M), yaw=robot.yaw
        )
        frame = developed(eye.take(round(now_s * 1e9), step, robot, camera))
        sight = judged(segmenter(frame).mask, frame.truth)
        if not chosen:
            chosen = sight.verdict is Verdict.SEEN
            if now_s > 10.0 or sight.verdict is Verdict.SOMEBODY_ELSE:
                return []
            continue
        if between(world, camera):
            near_since_s, ended = now_s, False
        elif not ended and now_s - near_since_s >= APART_S:
            ended = True
            crossings.append(Crossing(now_s - APART_S))
        for each in crossings:
            if now_s <= each.end_s + AFTER_S + 1e-6:
                if sight.verdict is Verdict.SEEN:
                    each.found_s = min(each.found_s, now_s - each.end_s)
                each.wrong = sight.verdict is Verdict.SOMEBODY_ELSE
    return [each for each in crossings if each.end_s + AFTER_S <= seconds]


def following(robot: Pose, world: World) -> Pose:
    """Return where a good follower is next: it turns to the target, and keeps its distance."""
    x, y = world.target_xy
    yaw = math.atan2(y - robot.y, x - robot.x)
    gap = math.hypot(x - robot.x, y - robot.y) - DESIRED_DISTANCE_M
    ahead = max(-0.15, min(0.15, gap))
    return world.grounded(
        Pose(robot.x + ahead * math.cos(yaw), robot.y + ahead * math.sin(yaw), yaw=yaw), 0.3
    )


def between(world: World, camera: Pose) -> bool:
    """Return whether somebody nearer overlaps the target from side to side."""
    away = np.hypot(*(world.people_xy - (camera.x, camera.y)).T)
    bearing = np.array([camera.bearing_to(x, y) for x, y in world.people_xy])
    half = np.arctan2(SHOULDERS_M / 2, away)
    nearer = (away[1:] < away[0]) & (np.abs(bearing[1:] - bearing[0]) < half[1:] + half[0])
    return bool(nearer.any())


if __name__ == "__main__":
    main()
