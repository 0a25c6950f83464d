"""Measure whether the lock keeps the right person when people cross in rendered worlds with known truth.

python benchmarks/identity.py [CROSSINGS] [--seed S] [--keep DIR] [--width PX]

A target and five others walk about, who step into the camera's line of sight again and again; in every second
world one of them wears the target's own clothes. A camera follows the target by the truth.

In a crossing, somebody nearer to the camera overlaps the target; it ends when nobody has for a second. Then
the target must be visible within half a second; else something else hides it, and the crossing is left out
and counted. The next two seconds decide, or less where the next crossing begins. Wrong: in most of their last
half second the lock is on somebody else. Their last picture alone does not decide, for whoever crosses next
may already cover a target in it that is rightly followed; it is counted, too. Found again: within them it was
on the target.

The lock itself takes little time; its inputs (pictures, boxes, appearances) take most of it. None of them
depends on the lock, since the camera follows the truth, and the detector's input size follows from the
target's true height. So each world is walked through twice, first without pictures, to know when people
cross, then with pictures from a second before each crossing until its verdict. With --keep the detections are
saved, a file for each world: a later call goes on from there, and another lock is judged by the same pictures
in seconds. Pictures are half as wide as a rehearsal's, and the detector's input is 256 px at most;
--width 640 uses a rehearsal's sizes for both.

In the second before a crossing the lock is told who the target is, unless it knows. Crossings before which
it does not have the target even so are left out and counted.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import MaskClass, at_size
from adatracker_deploy.core.sight import Verdict
from adatracker_deploy.core.task import DESIRED_DISTANCE_M
from adatracker_deploy.perception.boxes import overlap
from adatracker_deploy.perception.drawing import ellipses
from adatracker_deploy.perception.jpeg import developed
from adatracker_deploy.perception.models.nanodet import SIDE, NanoDet
from adatracker_deploy.perception.target.appearance import appearances
from adatracker_deploy.perception.target.lock import TargetLock
from adatracker_deploy.perception.target.motion import CameraMotion
from adatracker_deploy.perception.weights import shipped
from adatracker_deploy.sim import World, scene_names
from adatracker_deploy.sim.render.figure import shipped_people
from adatracker_deploy.sim.studio import Eye

FOV_RAD = math.radians(90.0)
RATE_HZ = 10
WIDTH, SMALL_SIDE = 640, 256
"""Width of a rehearsal's pictures, px; and the detector's input for smaller ones."""
WORLD_S = 180
OTHERS = 5
LEAD, AFTER, LAST, HIDDEN, APART = 10, 20, 5, 5, 10
"""Numbers of steps: of pictures before a crossing; from when the target is visible until the verdict; of
these, the last, which decide; after a crossing, within which the target must become visible; and at most
between two that count as one crossing."""
VISIBLE = 0.005
"""Share of the picture: about an eighth of somebody at the desired distance."""
SHOULDERS_M = 0.5
CAMERA_M = (0.4, 1.0, 1.7)
MATCH = 0.5
"""IoU with the target's visible part above which a box counts as the target's."""
TRUTH = 80
"""Rows and columns of the true masks that are kept."""


class Crossing(NamedTuple):
    """The first and the last step in which somebody overlaps the target."""

    begin: int
    end: int


class Walk(NamedTuple):
    """A world walked through without pictures: the camera's body at each step, and who crossed when."""

    robots: list[Pose]
    crossings: list[Crossing]


class Found(NamedTuple):
    """The detections in one picture, as the lock receives them, and the truth."""

    boxes: np.ndarray
    """In the picture's widths, shape (n, 4)."""
    scores: np.ndarray
    looks: np.ndarray
    motion: np.ndarray
    """In the picture's widths."""
    truth: np.ndarray
    """The class mask of the picture, of `TRUTH` rows and columns over its width."""

    @property
    def visible(self) -> bool:
        return bool(np.mean(self.truth == MaskClass.TARGET) > VISIBLE)

    def place(self) -> int | None:
        """Return the index of the target's box; None if no box matches it."""
        rows, columns = np.nonzero(self.truth == MaskClass.TARGET)
        if not len(rows) or not len(self.boxes):
            return None
        true = np.array([[columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]]) / TRUTH
        shared = overlap(self.boxes, true)[:, 0]
        return int(shared.argmax()) if shared.max() > MATCH else None

    def verdict(self, box: np.ndarray | None) -> Verdict | None:
        """Return whose box this is, by the pixels in its ellipse; None for no box."""
        if box is None:
            return None
        within = self.truth[ellipses(box[None], 1, 1, TRUTH)[0]]
        on_it = np.count_nonzero(within == MaskClass.TARGET)
        return Verdict.SEEN if on_it > np.count_nonzero(within == MaskClass.PERSON) else Verdict.SOMEBODY_ELSE


class Played(NamedTuple):
    """A world's crossings, and the detections in their pictures, by step."""

    crossings: list[Crossing]
    found: dict[int, Found]


@dataclass(slots=True)
class Tally:
    """Counts of one run."""

    crossings: int = 0
    wrong: int = 0
    wrong_at_end: int = 0
    """Crossings in whose last picture the lock is on somebody else."""
    found_s: list[float] = field(default_factory=list)
    """Times until the target was seen again, s, for the crossings after which that was in time."""
    hidden: int = 0
    unchosen: int = 0
    """Crossings before which the lock does not have the target."""

    def add(self, other: Tally) -> None:
        for name, value in asdict(other).items():
            setattr(self, name, getattr(self, name) + value)

    def __str__(self) -> str:
        count = max(self.crossings, 1)
        middle = f"{np.median(self.found_s):.2f} s" if self.found_s else "-"
        return (
            f"{self.crossings} crossings: somebody else {self.wrong / count:.2%} ({self.wrong}), in the last "
            f"picture {self.wrong_at_end / count:.2%} ({self.wrong_at_end}), found again "
            f"{len(self.found_s) / count:.1%}, after {middle} in the middle; "
            f"left out {self.hidden} hidden, {self.unchosen} not chosen"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("crossings", type=int, nargs="?", default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--width", type=int, default=320, help="of the pictures, px")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    side = SMALL_SIDE if arguments.width < WIDTH else SIDE
    detector = NanoDet(shipped("nanodet_g_int8.onnx"), ("person",), side=side)
    in_all = {alike: Tally() for alike in (False, True)}
    for number in itertools.count():
        seed, alike = arguments.seed * 10_000 + number, bool(number % 2)
        kept = arguments.keep / f"{seed}-{arguments.width}.npz" if arguments.keep else None
        if kept and kept.exists():
            played = read(kept)
        else:
            played = play(seed, arguments.width, detector, alike=alike)
            if kept:
                write(played, kept)
        counts = counted(played)
        in_all[alike].add(counts)
        print(f"world {seed}: {counts}", flush=True)
        if sum(each.crossings for each in in_all.values()) >= arguments.crossings:
            break
    print(f"different clothes: {in_all[False]}\none in like clothes: {in_all[True]}")
    in_all[False].add(in_all[True])
    print(f"all: {in_all[False]}")


def play(seed: int, width: int, detector: NanoDet, *, alike: bool) -> Played:
    """Take the pictures of a world's crossings, and look for people in them."""
    walk = walked(world_of(seed, alike=alike))
    wanted = {
        step
        for crossing in walk.crossings
        for step in range(crossing.begin - LEAD, crossing.end + 1 + HIDDEN + AFTER)
    }
    world = world_of(seed, alike=alike)
    eye = Eye(world, FOV_RAD, (width, width * 3 // 4), seed=seed)
    up_m = float(np.random.default_rng(seed).choice(CAMERA_M))
    camera_motion, tall = CameraMotion(), None
    found: dict[int, Found] = {}
    before = world.start
    for step, robot in enumerate(walk.robots[: max(wanted, default=-1) + 1]):
        world.step(1 / RATE_HZ, before)
        before = robot
        if step not in wanted:
            continue
        camera = Pose(
            robot.x, robot.y, robot.z + up_m, pitch=math.atan2(up_m - 0.9, DESIRED_DISTANCE_M), yaw=robot.yaw
        )
        frame = developed(eye.take(step * 10**9 // RATE_HZ, step, robot, camera))
        if step - 1 not in found:
            camera_motion, tall = CameraMotion(), None
        rows = np.flatnonzero((frame.truth.mask == MaskClass.TARGET).any(axis=1))
        tall = float(rows[-1] + 1 - rows[0]) / width if len(rows) else tall
        people = detector(frame.rgb, tall)
        motion = camera_motion(frame.rgb, people.boxes)
        motion[:, 2] /= width
        looks = appearances(frame.rgb, people.boxes)
        found[step] = Found(people.boxes / width, people.scores, looks, motion, squared(frame.truth.mask))
    return Played(walk.crossings, found)


def squared(mask: np.ndarray) -> np.ndarray:
    """Return a picture's mask over a square of its width, the picture at the top."""
    small = at_size(mask, TRUTH * mask.shape[0] // mask.shape[1], TRUTH)
    return np.pad(small, ((0, TRUTH - len(small)), (0, 0)))


def write(played: Played, kept: Path) -> None:
    kept.parent.mkdir(parents=True, exist_ok=True)
    columns = [list(column) for column in zip(*played.found.values(), strict=True)] or [[]] * 5
    boxes, scores, looks, motions, truths = columns
    part = kept.with_suffix(".part")
    with part.open("wb") as file:
        np.savez_compressed(
            file,
            crossings=np.array(played.crossings, int).reshape(-1, 2),
            steps=np.array(list(played.found), int),
            counts=np.array([len(each) for each in boxes], int),
            boxes=np.concatenate(boxes or [np.empty((0, 4))]),
            scores=np.concatenate(scores or [np.empty(0)]),
            looks=np.concatenate(looks or [np.empty((0, 3, 128))]),
            motions=np.array(motions),
            truths=np.array(truths),
        )
    part.replace(kept)


def read(kept: Path) -> Played:
    with np.load(kept) as file:
        values = dict(file)
    ends = np.cumsum(values["counts"])
    found = {}
    for place, (step, end) in enumerate(zip(values["steps"].tolist(), ends.tolist(), strict=True)):
        those = slice(end - int(values["counts"][place]), end)
        people = (values[name][those] for name in ("boxes", "scores", "looks"))
        found[step] = Found(*people, values["motions"][place], values["truths"][place])
    return Played([Crossing(*each) for each in values["crossings"].tolist()], found)


class Follower:
    """The lock, fed with the detections, step by step."""

    def __init__(self, found: dict[int, Found]) -> None:
        self._found = found
        self._lock: TargetLock | None = None
        self._last = -1

    def look(self, step: int, *, told: bool = False) -> Verdict | None:
        """Return the verdict on the lock's choice; with `told`, put it on the target first if it is not."""
        here, t_ns = self._found[step], step * 10**9 // RATE_HZ
        if step != self._last + 1:
            self._lock = None
        self._last = step
        verdict = None
        if self._lock is not None:
            locked = self._lock.update(here.boxes, here.scores, here.looks, here.motion, t_ns)
            expected = None if locked.expected is None else np.array(locked.expected, np.float32)
            verdict = here.verdict(expected if locked.place is None else here.boxes[locked.place])
        place = here.place() if told and verdict is not Verdict.SEEN else None
        if place is not None:
            self._lock = TargetLock()
            self._lock.choose(place, here.boxes, here.looks, t_ns)
            verdict = Verdict.SEEN
        return verdict


def counted(played: Played) -> Tally:
    """Play the lock over a world's crossings, and judge it after each."""
    tally, follower = Tally(), Follower(played.found)
    verdict, now = None, 0
    nexts = [later.begin for later in played.crossings[1:]] + [math.inf]
    for (begin, end), next_begin in zip(played.crossings, nexts, strict=True):
        for step in range(max(begin - LEAD, now), begin):
            verdict = follower.look(step, told=True)
        chosen, now = verdict is Verdict.SEEN, end + 1
        for step in range(begin, now):
            verdict = follower.look(step)
        after = range(now, now + HIDDEN)
        visible = next((step for step in after if played.found[step].visible), None)
        if not chosen:
            tally.unchosen += 1
        elif visible is None:
            tally.hidden += 1
        else:
            last = int(min(visible + AFTER, next_begin - 1))
            verdicts = [follower.look(step) for step in range(now, last + 1)][visible - now :]
            verdict, now = verdicts[-1], last + 1
            tally.crossings += 1
            tally.wrong += 2 * verdicts[-LAST:].count(Verdict.SOMEBODY_ELSE) > len(verdicts[-LAST:])
            tally.wrong_at_end += verdict is Verdict.SOMEBODY_ELSE
            if Verdict.SEEN in verdicts:
                tally.found_s.append(verdicts.index(Verdict.SEEN) / RATE_HZ)
    return tally


def world_of(seed: int, *, alike: bool) -> World:
    people = shipped_people()
    target, other = np.random.default_rng(seed).permutation(len(people))[:2]
    return World(
        scene_names()[seed // 2 % len(scene_names())],
        seed=seed,
        path="random_walk",
        others=OTHERS,
        crossing=OTHERS,
        cast=(people[target], people[target if alike else other]),
    )


def walked(world: World) -> Walk:
    """Follow the target by the truth; people who meet again within a second cross once."""
    robot, robots = world.start, []
    crossings: list[Crossing] = []
    for step in range(WORLD_S * RATE_HZ):
        world.step(1 / RATE_HZ, robot)
        robot = following(robot, world)
        robots.append(robot)
        if not between(world, robot):
            continue
        if crossings and step - crossings[-1].end <= APART:
            crossings[-1] = crossings[-1]._replace(end=step)
        else:
            crossings.append(Crossing(step, step))
    whole = [each for each in crossings if each.begin >= LEAD and each.end + HIDDEN + AFTER < len(robots)]
    return Walk(robots, whole)


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
