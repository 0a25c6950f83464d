"""Whether the eyes keep the right person when people cross in rendered worlds, where the truth is known.

python benchmarks/identity.py [CROSSINGS] [--seed S] [--log FILE]

A target and five others walk about, who step into the camera's line of sight again and again; in every second
world one of them wears the target's own clothes. A camera follows the target by the truth, and the embedded
segmenter is told nothing but the pictures.

In a crossing, somebody nearer to the camera overlaps the target, until nobody has for a second. Then the
target must be visible within half a second; else something else hides it, which is left out and counted. From
there on two seconds decide, or less where the next crossing begins. Wrong: at their end the segmenter has
somebody else. Found again: within them it had the target.

The camera needs no eyes, so each world is walked through twice: first without pictures, to know when people
cross, then with pictures from two seconds before each crossing until its verdict. There the segmenter
is told to follow whoever is in the middle, unless it has the target. Left out, and counted: crossings before
which it did not get it.

Each world is printed when it is done, and with --log kept in a file from which a later call goes on.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.core.sight import Verdict, judged
from adatracker_deploy.core.task import DESIRED_DISTANCE_M
from adatracker_deploy.perception.jpeg import developed
from adatracker_deploy.perception.segmenters import EMBEDDED, open_segmenter
from adatracker_deploy.perception.target.choice import Choice
from adatracker_deploy.sim import World, scene_names
from adatracker_deploy.sim.render.figure import shipped_people
from adatracker_deploy.sim.studio import Eye

FOV_RAD = math.radians(90.0)
RATE_HZ = 10
WORLD_S = 180
OTHERS = 5
LEAD, AFTER, HIDDEN, APART = 20, 20, 5, 10
"""Steps of a crossing's pictures before it; from when the target is visible until the verdict; after a
crossing in which the target must become visible; and between two crossings."""
VISIBLE = 0.005
"""Share of the picture: about an eighth of somebody at the desired distance."""
SHOULDERS_M = 0.5
CAMERA_M = (0.4, 1.0, 1.7)
MIDDLE = Choice(numbers=(0.5, 0.5))


class Crossing(NamedTuple):
    """The first and the last step in which somebody overlaps the target."""

    begin: int
    end: int


class Walk(NamedTuple):
    """A world walked through without pictures: the camera's body at each step, and who crossed when."""

    robots: list[Pose]
    crossings: list[Crossing]


class Look(NamedTuple):
    """One picture: what the segmenter made of it, and whether the target is visible in it."""

    verdict: Verdict
    visible: bool


@dataclass(slots=True)
class Tally:
    """Counts of one run."""

    crossings: int = 0
    wrong: int = 0
    found_s: list[float] = field(default_factory=list)
    """Times, s, until the target was seen again; of crossings after which that was in time."""
    hidden: int = 0
    unchosen: int = 0
    """Crossings before which somebody else, or nobody, was chosen."""
    visible: int = 0
    """Pictures from the beginning of a counted crossing until its verdict that show the target."""
    seen: int = 0
    """Those in which it was seen."""
    pictures: int = 0

    def add(self, other: Tally) -> None:
        for name, value in asdict(other).items():
            setattr(self, name, getattr(self, name) + value)

    def __str__(self) -> str:
        count = max(self.crossings, 1)
        middle = f"{np.median(self.found_s):.2f} s" if self.found_s else "-"
        return (
            f"{self.crossings} crossings: somebody else {self.wrong / count:.2%} ({self.wrong}), found again "
            f"{len(self.found_s) / count:.1%}, after {middle} in the middle; "
            f"seen in {self.seen / max(self.visible, 1):.1%} of {self.visible} pictures that show it; "
            f"left out {self.hidden} hidden, {self.unchosen} not chosen"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("crossings", type=int, nargs="?", default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--log", type=Path)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    done = read(arguments.log)
    in_all = {alike: Tally() for alike in (False, True)}
    for number in itertools.count():
        seed, alike = arguments.seed * 10_000 + number, bool(number % 2)
        found = done[seed] if seed in done else crossed(seed, alike=alike)
        if arguments.log and seed not in done:
            with arguments.log.open("a") as log:
                log.write(json.dumps({"seed": seed, **asdict(found)}) + "\n")
        in_all[alike].add(found)
        print(f"world {seed}: {found}", flush=True)
        if sum(each.crossings for each in in_all.values()) >= arguments.crossings:
            break
    print(f"different clothes: {in_all[False]}\none in like clothes: {in_all[True]}")
    in_all[False].add(in_all[True])
    print(f"all: {in_all[False]}")


def read(log: Path | None) -> dict[int, Tally]:
    """Return the worlds that are done, by seed."""
    lines = log.read_text().splitlines() if log and log.exists() else []
    worlds = (json.loads(line) for line in lines)
    return {world.pop("seed"): Tally(**world) for world in worlds}


def crossed(seed: int, *, alike: bool) -> Tally:
    """Play a world, and count its crossings."""
    walk = walked(world_of(seed, alike=alike))
    return counted(walk.crossings, looked(world_of(seed, alike=alike), walk, seed))


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


def looked(world: World, walk: Walk, seed: int) -> dict[int, Look]:
    """Take the crossings' pictures; return what the segmenter made of each, by step."""
    wanted = {
        step
        for crossing in walk.crossings
        for step in range(crossing.begin - LEAD, crossing.end + 1 + HIDDEN + AFTER)
    }
    eye = Eye(world, FOV_RAD, seed=seed)
    up_m = float(np.random.default_rng(seed).choice(CAMERA_M))
    segmenter = open_segmenter(EMBEDDED, "person", MIDDLE)[0]
    leads = {crossing.begin - LEAD for crossing in walk.crossings}
    looks: dict[int, Look] = {}
    before = world.start
    for step, robot in enumerate(walk.robots[: max(wanted, default=-1) + 1]):
        world.step(1 / RATE_HZ, before)
        before = robot
        if step not in wanted:
            continue
        if step in leads and not (step - 1 in looks and looks[step - 1].verdict is Verdict.SEEN):
            segmenter.reset()
        camera = Pose(
            robot.x, robot.y, robot.z + up_m, pitch=math.atan2(up_m - 0.9, DESIRED_DISTANCE_M), yaw=robot.yaw
        )
        frame = developed(eye.take(step * 10**9 // RATE_HZ, step, robot, camera))
        visible = bool(np.mean(frame.truth.mask == MaskClass.TARGET) > VISIBLE)
        looks[step] = Look(judged(segmenter(frame).mask, frame.truth).verdict, visible)
    return looks


def counted(crossings: list[Crossing], looks: dict[int, Look]) -> Tally:
    """Judge each crossing by the looks before and after it."""
    tally = Tally(pictures=len(looks))
    nexts = [later.begin for later in crossings[1:]] + [math.inf]
    for (begin, end), next_begin in zip(crossings, nexts, strict=True):
        lead = [looks[step].verdict for step in range(begin - LEAD, begin)]
        taken = [verdict for verdict in lead if verdict in (Verdict.SEEN, Verdict.SOMEBODY_ELSE)]
        after = range(end + 1, end + 1 + HIDDEN)
        visible = next((step for step in after if looks[step].visible), None)
        if not taken or taken[-1] is not Verdict.SEEN:
            tally.unchosen += 1
        elif visible is None:
            tally.hidden += 1
        else:
            tally.crossings += 1
            last = int(min(visible + AFTER, next_begin - 1))
            verdicts = [looks[step].verdict for step in range(visible, last + 1)]
            shown = [looks[step] for step in range(begin, last + 1) if looks[step].visible]
            tally.visible += len(shown)
            tally.seen += sum(look.verdict is Verdict.SEEN for look in shown)
            tally.wrong += verdicts[-1] is Verdict.SOMEBODY_ELSE
            if Verdict.SEEN in verdicts:
                tally.found_s.append(verdicts.index(Verdict.SEEN) / RATE_HZ)
    return tally


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
