"""A little world for the lock: people in coloured clothes walk past each other before a camera that may pan.

Everybody is painted, the farthest first, and described by the toolkit's own `appearances`: so somebody half
hidden looks half like the person in front. Somebody mostly hidden, or out of the picture, is not detected.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from adatracker_deploy.perception.target.appearance import appearances
from adatracker_deploy.perception.target.lock import TargetLock
from adatracker_deploy.perception.target.motion import STILL

ROWS, COLUMNS = 160, 480
RATE_HZ = 20
TALL, WIDE = 100, 40
GROUND = 90
"""Brightness of the wall behind everybody."""
LEAST_SEEN = 0.5
"""Least visible share of a person at which they are detected."""

CLOTHES = {
    "red": ((200, 30, 30), (180, 60, 60), (40, 40, 90)),
    "green": ((30, 160, 40), (60, 140, 60), (150, 120, 60)),
    "blue": ((30, 60, 200), (60, 60, 180), (200, 200, 200)),
    "yellow": ((220, 210, 40), (190, 180, 60), (90, 30, 30)),
    "white": ((240, 240, 240), (200, 230, 240), (30, 120, 130)),
}
"""Colours of chest, waist and legs."""
SIMILAR = {
    "red with green trousers": (*CLOTHES["red"][:2], CLOTHES["green"][2]),
    "red under a blue coat": (*CLOTHES["blue"][:2], CLOTHES["red"][2]),
}
"""Clothes that must not be taken for red."""


@dataclass(frozen=True)
class Walker:
    """A person; of two in one place the one later in the world's list is nearer."""

    clothes: str
    x: Callable[[float], float]
    """Their middle at a time, s -> px of the world."""
    here: Callable[[float], bool] = lambda t_s: True
    tall: int = TALL


@dataclass
class Sight:
    """The detections in one picture."""

    t_ns: int
    who: list[int]
    """The number of each box's walker."""
    boxes: np.ndarray
    looks: np.ndarray
    motion: np.ndarray
    scores: np.ndarray = field(init=False)

    def __post_init__(self):
        self.scores = np.full(len(self.who), 0.9, np.float32)


def steady(x):
    return lambda t_s: x


def moving(start, speed):
    return lambda t_s: start + speed * t_s


def along(times, places):
    """Walk from place to place at these times, s; stand before and after."""
    return lambda t_s: float(np.interp(t_s, times, places))


def looking(kinds):
    """Return made-up looks, shape (kinds, 3, 128); those that are two kinds apart have nothing in common."""
    looks = np.zeros((len(kinds), 3, 128), np.float32)
    for look, kind in zip(looks, kinds, strict=True):
        look[:, kind : kind + 2] = np.sqrt(0.5)
    return looks


def sights(walkers, seconds, pan=lambda t_s: 0.0, order=None, measured=lambda t_s, motion: motion):
    """Yield the detections of each picture, in the world's order; `order` may reorder or drop them, and the
    camera's motion, px, may be `measured` wrongly."""
    before = pan(0.0)
    for number in range(round(seconds * RATE_HZ) + 1):
        t_s = number / RATE_HZ
        motion = np.array([[1.0, 0, measured(t_s, before - pan(t_s))], [0, 1, 0]])
        before = pan(t_s)
        yield _sight(walkers, t_s, before, motion, order)


def _sight(walkers, t_s, pan, motion, order):
    picture = np.full((ROWS, COLUMNS, 3), GROUND, np.uint8)
    owner = np.full((ROWS, COLUMNS), -1)
    boxes = {}
    for number, walker in enumerate(walkers):
        if not walker.here(t_s):
            continue
        middle, wide = walker.x(t_s) - pan, walker.tall * WIDE / TALL
        left, right = round(middle - wide / 2), round(middle + wide / 2)
        bottom = ROWS - 10
        top = bottom - walker.tall
        inside = slice(max(0, left), max(0, right))
        head, waist, hips = (top + round(share * walker.tall) for share in (0.1, 0.34, 0.54))
        for begin, end, colour in zip(
            (head, waist, hips), (waist, hips, bottom), (CLOTHES | SIMILAR)[walker.clothes], strict=True
        ):
            picture[begin:end, inside] = colour
        owner[top:bottom, inside] = number
        boxes[number] = (max(0, left), top, min(COLUMNS, right), bottom)
    size = {n: walkers[n].tall * round(walkers[n].tall * WIDE / TALL) for n in boxes}
    who = [n for n in boxes if (owner == n).sum() >= LEAST_SEEN * size[n]]
    if order is not None:
        order(who)
    found = np.array([boxes[n] for n in who], np.float32).reshape(-1, 4)
    return Sight(round(t_s * 1e9) + 7_000_000_000, who, found, appearances(picture, found), motion)


def follow(walkers, seconds, target=0, **how):
    """Choose the target in the first picture; return (sight, the lock's answer) for each picture."""
    lock = TargetLock()
    said = []
    for sight in sights(walkers, seconds, **how):
        if not said:
            answer = lock.choose(sight.who.index(target), sight.boxes, sight.looks, sight.t_ns)
        else:
            answer = lock.update(sight.boxes, sight.scores, sight.looks, sight.motion, sight.t_ns)
        said.append((sight, answer))
    return said


def followed(said):
    """Return the number of the walker taken for the target in each picture; None while nobody was."""
    return [None if answer.place is None else sight.who[answer.place] for sight, answer in said]


def states(said):
    return [answer.state for _, answer in said]


def mixture(share):
    """Return a look of which a share is not the target's: its likeness is the square root of the rest."""
    return np.sqrt((1 - share) * np.square(looking([0])) + share * np.square(looking([2])))


def answers(first, pictures, sure=None):
    """Return the lock's (state, index of the target's box) for each (boxes, looks), at 20 Hz; `sure` has for
    each how many of the boxes are surely people's, by default all."""
    lock = TargetLock()
    lock.choose(0, *first, 0)
    said = []
    for number, (boxes, looks) in enumerate(pictures, start=1):
        scores = np.full(len(boxes), 0.9, np.float32)
        surely = None if sure is None else sure[number - 1]
        answer = lock.update(boxes, scores, looks, STILL, number * 50_000_000, sure=surely)
        said.append((answer.state, answer.place))
    return said
