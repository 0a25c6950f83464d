"""The target lock: finds the chosen person among the boxes of each image (re-identification).

The target is tracked by predicted position and appearance, together with everybody else in view: all tracks
compete for the boxes, from where they are if the camera moved as measured or if it did not, whichever fits
better. A target out of sight for too long is lost. It is reacquired only by a person who is similar to the
target, more similar than everybody else, and more similar than that person was while beside the target; who
hid it is not taken for it. Who came after it had gone may be it before it is lost, unless somebody stands
where it is expected. Until then there is no target. Where the chosen box held two people, the target is the
one who looks more like it once they are apart. Time is passed in; the same images give the same results.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.messages import TargetState
from adatracker_deploy.perception.boxes import overlap, within
from adatracker_deploy.perception.target.appearance import is_cut
from adatracker_deploy.perception.target.motion import STILL
from adatracker_deploy.perception.target.people import Person, assigned
from adatracker_deploy.perception.target.recognition import (
    BRIDGED_S,
    HIDING,
    Other,
    Picture,
    Target,
    is_elsewhere,
    outdone,
    taken_back,
    who_stands_before,
)

if TYPE_CHECKING:
    from adatracker_deploy.perception.roles import Boxes
    from adatracker_deploy.perception.target.motion import Motion

_TAKEN = 0.3
"""IoU with somebody's box from which on the target is not expected there, but behind them."""
FORGET_S = 2.0
"""Time out of sight after which another person's track is deleted."""
CROWDED = 0.1
"""IoU with another box above which an appearance is not trusted or learnt."""
_NEW_SCORE = 0.45
"""Least score of an unmatched box that starts a new track."""
_SAME, _NESTED = 0.5, 0.85
"""IoU with the target's box, and share of the smaller one within the other, from which on an unmatched box is
a second one on the target and starts no track, which would take the target's next box for its own."""
_LEAST_ALIKE, _LEAST_ALIKE_AGAIN, _LEAST_ALIKE_OTHERS = 0.5, 0.6, 0.4
"""Likeness below which a box is not the target's; not its when it was missed for longer than `BRIDGED_S`; and
not another person's. The second leaves three instead of five of 228 people of jittered street footage on
somebody else."""
_LEARN = 0.1
"""Share of another person's new appearance blended into the known one."""


class Locked(NamedTuple):
    """The lock's result for one image."""

    state: TargetState
    place: int | None
    """Index of the target's box; None while there is none."""
    likeness: float
    """Similarity of that box to the target, 0 to 1; 0 without a box."""
    expected: tuple[float, float, float, float] | None = None
    """The target's predicted box (left, top, right, bottom), px, while it has been missed for `BRIDGED_S`
    at most and nobody else was found there."""


class _Tracked(NamedTuple):
    """Everybody in one of the places where they may be, and whose the boxes of the picture are then."""

    target: Target
    others: list[Other]
    place: int | None
    """The target's box; None where it has none."""
    theirs: dict[int, int]
    """The others', as {box: place in `others`}."""
    fit: float
    """How well they fit, in all."""


class TargetLock:
    """Tracks one person; call `choose` before `update`."""

    def __init__(self) -> None:
        self._target: Target | None = None
        self._others: list[Other] = []
        self._t_ns = 0

    def choose(self, place: int, boxes: Boxes, looks: NDArray[np.float32], t_ns: int) -> Locked:
        """Start with the person in one of the boxes; forget any previous target.

        Args:
            place: in `boxes`.
            boxes: of everybody in the picture, px, shape (n, 4).
            looks: how they look, shape (n, 3, 128).
            t_ns: when the picture was taken.
        """
        self._t_ns = t_ns
        everybody = [Person.new(box, look) for box, look in zip(boxes, looks, strict=True)]
        target = everybody.pop(place)
        self._target = Target.chosen(target)
        self._others = [Other(person) for person in everybody]
        return Locked(TargetState.TRACKED, place, 1.0)

    def update(
        self,
        boxes: Boxes,
        scores: NDArray[np.float32],
        looks: NDArray[np.float32],
        motion: Motion,
        t_ns: int,
        *,
        sure: int | None = None,
    ) -> Locked:
        """Find the target among the people in the next image.

        Args:
            boxes: of everybody in the picture, px, shape (n, 4).
            scores: the detector's, shape (n,).
            looks: how they look, shape (n, 3, 128).
            motion: of the camera since the last picture.
            t_ns: when the picture was taken.
            sure: how many of the boxes, the first ones, are surely people's; by default all. The others only
                continue the track of a target that is in none of the first, or of who stands before it (Zhang
                et al. 2022, "ByteTrack: multi-object tracking by associating every detection box").

        Raises:
            RuntimeError: nobody has been chosen.
        """
        if self._target is None:
            raise RuntimeError("no target has been chosen")
        dt_s, self._t_ns = max(0.0, (t_ns - self._t_ns) / 1e9), t_ns
        was_lost = self._target.lost
        alike = self._target.alike(looks)
        sure = len(boxes) if sure is None else sure
        rows = list(range(sure))
        target, others, place, theirs, _ = max(
            (self._tracked(each, dt_s, boxes[rows], looks[rows], alike[rows]) for each in (motion, STILL)),
            key=lambda tracked: tracked.fit,
        )
        faint = None if was_lost or place is not None else _faintly(target, boxes, looks, alike, sure)
        if faint is not None:
            rows = [*rows, faint]
            place, theirs = _yielded(sure, boxes[faint], target, others, theirs)
        free = _standing_free(boxes[rows])
        free[sure:] = False  # a doubtful box teaches nothing
        here = Picture(
            boxes[rows], scores[rows], looks[rows], alike[rows], target.as_chosen(looks[rows]), free
        )
        if place is not None and is_elsewhere(target, here, place, others, theirs):
            place = None
        target = replace(target, clear_s=0.0) if place is None else target.seen(here, place)
        known = _others_in(here, others, theirs, target, place)
        unseen = [other for row, other in enumerate(others) if row not in theirs.values()]
        gone = target.lost or (target.person.unseen_s > BRIDGED_S and not _is_covered(target, here.boxes))
        again = taken_back(known, target, here) if place is None and gone else None
        if again is not None:
            place, found = known.pop(again)
            target = replace(target, person=found.person)
        mistaken = outdone(known, target)
        if mistaken is not None and place is not None:
            (right, other), known[mistaken] = known[mistaken], (place, Other(target.person, apart=True))
            place, target = right, replace(target, person=other.person)
        self._target = target
        self._others = [other for _, other in known]
        self._others += [other for other in unseen if other.person.unseen_s <= FORGET_S]
        if place is None:
            state = TargetState.LOST if target.lost else TargetState.COASTING
            return Locked(state, None, 0.0, _expected(target, here.boxes))
        state = TargetState.REACQUIRED if was_lost else TargetState.TRACKED
        return Locked(state, rows[place], float(here.alike[place]))

    def _tracked(
        self,
        motion: Motion,
        dt_s: float,
        boxes: Boxes,
        looks: NDArray[np.float32],
        alike: NDArray[np.float32],
    ) -> _Tracked:
        """Return everybody where they are if the camera moved so, and whose the boxes are then."""
        assert self._target is not None
        target = self._target.expected(motion, dt_s)
        others = [replace(other, person=other.person.expected(motion, dt_s)) for other in self._others]
        place, theirs, fit = _places(None if self._target.lost else target, others, boxes, looks, alike)
        if place is not None:
            place, theirs = _yielded(place, boxes[place], target, others, theirs)
        return _Tracked(target, others, place, theirs, fit)


def _yielded(
    place: int, box: NDArray[np.float32], target: Target, others: list[Other], theirs: dict[int, int]
) -> tuple[int | None, dict[int, int]]:
    """Return the target's place and the others', after who stands before the target has got that box."""
    before = who_stands_before(target, box, others, theirs)
    return (place, theirs) if before is None else (None, {**theirs, place: before})


def _expected(target: Target, boxes: Boxes) -> tuple[float, float, float, float] | None:
    """Return where a target that has just been missed is, unless somebody else was found there."""
    box = target.person.box.astype(np.float32)
    if target.person.unseen_s > BRIDGED_S or overlap(box[None], boxes).max(initial=0.0) >= _TAKEN:
        return None
    left, top, right, bottom = box.tolist()
    return left, top, right, bottom


def _is_covered(target: Target, boxes: Boxes) -> bool:
    """Return whether somebody stands before the place where the target is expected."""
    place = target.person.box.astype(np.float32)
    return any(bool(within(place[None], box)[0] >= HIDING) for box in boxes)


def _places(
    target: Target | None,
    others: list[Other],
    boxes: Boxes,
    looks: NDArray[np.float32],
    alike: NDArray[np.float32],
) -> tuple[int | None, dict[int, int], float]:
    """Return the target's box, None for a target that is None or unseen; the others' as {box: place}; and how
    well they fit, in all.

    `alike` is how alike each look is to the target's.
    """
    first = 0 if target is None else 1
    people = [*(() if target is None else (target.person,)), *(other.person for other in others)]
    rows = [*(() if target is None else (alike,)), *(person.alike(looks) for person in people[first:])]
    gone = target is not None and target.person.unseen_s > BRIDGED_S
    least = [_LEAST_ALIKE_AGAIN if gone else _LEAST_ALIKE] * first + [_LEAST_ALIKE_OTHERS] * len(others)
    cut = np.array([is_cut(look) for look in looks], bool)
    shares = np.array(rows).reshape(len(people), len(boxes))
    owner, fit = assigned(people, boxes.astype(np.float64), shares, least, cut)
    place = owner.pop(0, None) if first else None
    return place, {box: row - first for row, box in owner.items()}, fit


def _faintly(
    target: Target, boxes: Boxes, looks: NDArray[np.float32], alike: NDArray[np.float32], sure: int
) -> int | None:
    """Return which of the boxes after the first `sure` ones is the target's; None if none is, or it is
    somebody's."""
    place, *_ = _places(target, [], boxes[sure:], looks[sure:], alike[sure:])
    if place is None or overlap(boxes[sure + place][None], boxes[:sure]).max(initial=0.0) >= _TAKEN:
        return None
    return sure + place


def _standing_free(boxes: Boxes) -> NDArray[np.bool_]:
    """Return for each box whether it is unoccluded."""
    covering = overlap(boxes, boxes)
    np.fill_diagonal(covering, 0.0)
    return np.asarray(covering.max(axis=1, initial=0.0) < CROWDED)


def _others_in(
    here: Picture, others: list[Other], theirs: dict[int, int], target: Target, place: int | None
) -> list[tuple[int, Other]]:
    """Return everybody but the target, which is at `place`, with their boxes' numbers."""
    beside = None if place is None or not here.free[place] else float(here.alike[place])
    mine = target.person.box.astype(np.float32)
    known: list[tuple[int, Other]] = []
    for box, (where, score, look, alike, chosen, free) in enumerate(zip(*here, strict=True)):
        if box == place:
            continue
        if box in theirs:
            other = others[theirs[box]]
            other = replace(other, person=other.person.seen(where, look, _LEARN if free else 0.0))
            other = other.placed(target, seen=place is not None)
        elif score >= _NEW_SCORE and (place is None or not _is_second(where, mine)):
            split = place is not None and bool(overlap(where[None], mine[None])[0, 0] >= CROWDED)
            other = Other(Person.new(where, look), split=split, late=target.lost)
        else:
            continue
        if free:
            sure = beside is not None and float(alike) <= beside
            other = other.compared(float(alike), target, beside=sure)
            if beside is not None:
                other = other.rivals(float(chosen - here.chosen[place]))
        known.append((box, other))
    return known


def _is_second(box: NDArray[np.float32], mine: NDArray[np.float32]) -> bool:
    """Return whether a box is a second one on the target, whose box is `mine`."""
    nested = max(within(box[None], mine)[0], within(mine[None], box)[0])
    return bool(overlap(box[None], mine[None])[0, 0] >= _SAME and nested >= _NESTED)
