"""The target lock: which box in each picture is the person that was chosen at the start.

The target is kept by where they must be, by what they look like, and by what everybody else in view does: all
compete for the boxes. Whoever was out of sight for too long is lost, and taken back only when they look like
the target again, more than everybody else does, and more than they themselves did when the target stood
beside them. Until then nobody is the target. Time is passed in; the same pictures give the same answers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.messages import TargetState
from adatracker_deploy.perception.boxes import centres, heights, overlap
from adatracker_deploy.perception.target.appearance import likeness
from adatracker_deploy.perception.target.people import Person, assigned

if TYPE_CHECKING:
    from adatracker_deploy.perception.roles import Boxes
    from adatracker_deploy.perception.target.appearance import Appearance
    from adatracker_deploy.perception.target.motion import Motion

COAST_S = 1.0
"""Out of sight for longer, the target is lost."""
FORGET_S = 2.0
"""Out of sight for longer, somebody else is forgotten."""
CROWDED = 0.1
"""Overlap with another box from which a look is not to be trusted, and nothing is learnt."""
_NEW_SCORE = 0.45
"""Of a box that nobody's place explains, to count as somebody new."""
_LEAST_ALIKE, _LEAST_ALIKE_OTHERS = 0.5, 0.4
_LEARN, _LEARN_OTHERS = 0.05, 0.1
"""Share of a new look that goes into the known one."""
_USUAL_ALIKE = 0.75
"""How alike a person stays to themselves from picture to picture: the median on street footage was 0.74."""
_SMOOTHING, _SMOOTHING_USUAL = 0.4, 0.1

_DROP = 0.1
"""By how much less alike than usual whoever is taken back may be."""
_MARGIN = 0.03
"""By how much more alike than the next."""
_MARGIN_BEFORE = 0.06
"""By how much more alike than they were beside the target: boxes of two who cross may have been swapped."""
_CONFIRM = 3
"""Pictures in a row that must say so."""
_REACH, _REACH_PER_S = 1.5, 2.5
"""How far from where the target was lost, in the target's heights: people are 1.7 m tall and run at 4 m/s."""
_OTHER_SIZE = 0.5


class Locked(NamedTuple):
    """What the lock says of one picture."""

    state: TargetState
    place: int | None
    """Which of the boxes is the target; None while it is in none of them."""
    likeness: float
    """Of that box to what is known of the target, 0 to 1; 0 with None."""


@dataclass(frozen=True, slots=True)
class _Target:
    person: Person
    first_look: Appearance
    usual: float = _USUAL_ALIKE
    """How alike the target is to itself."""

    @property
    def lost(self) -> bool:
        return self.person.unseen_s > COAST_S

    def alike(self, looks: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return how alike each look is to the target's as it is now, or as it was first."""
        return np.maximum(self.person.alike(looks), likeness(looks, self.first_look))


@dataclass(frozen=True, slots=True)
class _Other:
    person: Person
    alike: float | None = None
    """To the target, of late; None before they stood free."""
    alike_beside: float | None = None
    """The same while the target stood free beside them; None if it never did."""
    agreed: int = 0
    """Pictures in a row in which they looked like the target that is lost."""


class TargetLock:
    """Keeps one person; `choose` comes before `update`."""

    def __init__(self) -> None:
        self._target: _Target | None = None
        self._others: list[_Other] = []
        self._t_ns = 0

    def choose(self, place: int, boxes: Boxes, looks: NDArray[np.float32], t_ns: int) -> Locked:
        """Begin with the person in one of the boxes; who was the target before is forgotten.

        Args:
            place: in `boxes`.
            boxes: of everybody in the picture, px, shape (n, 4).
            looks: how they look, shape (n, 3, 128).
            t_ns: when the picture was taken.
        """
        self._t_ns = t_ns
        everybody = [Person.new(box, look) for box, look in zip(boxes, looks, strict=True)]
        target = everybody.pop(place)
        self._target = _Target(target, target.look)
        self._others = [_Other(person) for person in everybody]
        return Locked(TargetState.TRACKED, place, 1.0)

    def update(
        self,
        boxes: Boxes,
        scores: NDArray[np.float32],
        looks: NDArray[np.float32],
        motion: Motion,
        t_ns: int,
    ) -> Locked:
        """Return which of the people in the next picture is the target.

        Args:
            boxes: of everybody in the picture, px, shape (n, 4).
            scores: the detector's, shape (n,).
            looks: how they look, shape (n, 3, 128).
            motion: of the camera since the last picture.
            t_ns: when the picture was taken.

        Raises:
            RuntimeError: nobody has been chosen.
        """
        if self._target is None:
            raise RuntimeError("no target has been chosen")
        dt_s, self._t_ns = max(0.0, (t_ns - self._t_ns) / 1e9), t_ns
        was_lost = self._target.lost
        target = replace(self._target, person=self._target.person.expected(motion, dt_s))
        others = [replace(other, person=other.person.expected(motion, dt_s)) for other in self._others]
        alike = target.alike(looks)
        place, theirs = _places(None if was_lost else target, others, boxes, looks, alike)
        free = _standing_free(boxes)
        if place is not None:
            likeliest = _likeliest_other(place, alike, free, theirs, others)
            place = None if _is_elsewhere(target, float(alike[place]), likeliest) else place
        if place is not None:
            target = _with_sight(
                target, boxes[place], looks[place], float(alike[place]), free=bool(free[place])
            )
        beside = place is not None and bool(free[place])
        known: list[tuple[int, _Other]] = []
        for box in range(len(boxes)):
            if box == place:
                continue
            if box in theirs:
                other = _seen(others[theirs[box]], boxes[box], looks[box] if free[box] else None)
            elif scores[box] >= _NEW_SCORE:
                other = _Other(Person.new(boxes[box], looks[box]))
            else:
                continue
            if free[box]:
                other = _compared(other, float(alike[box]), target, beside=beside)
            known.append((box, other))
        unseen = [other for row, other in enumerate(others) if row not in theirs.values()]
        again = _taken_back(known, target, free) if was_lost else None
        if again is not None:
            place, found = known.pop(again)
            target = replace(target, person=found.person)
        self._target = target
        self._others = [other for _, other in known]
        self._others += [other for other in unseen if other.person.unseen_s <= FORGET_S]
        if place is None:
            return Locked(TargetState.LOST if target.lost else TargetState.COASTING, None, 0.0)
        state = TargetState.REACQUIRED if was_lost else TargetState.TRACKED
        return Locked(state, place, float(alike[place]))


def _places(
    target: _Target | None,
    others: list[_Other],
    boxes: Boxes,
    looks: NDArray[np.float32],
    alike: NDArray[np.float32],
) -> tuple[int | None, dict[int, int]]:
    """Return the target's box, None for a target that is None or unseen, and the others' as {box: place}.

    `alike` is how alike each look is to the target's.
    """
    first = 0 if target is None else 1
    people = [*(() if target is None else (target.person,)), *(other.person for other in others)]
    rows = [*(() if target is None else (alike,)), *(person.alike(looks) for person in people[first:])]
    least = [_LEAST_ALIKE] * first + [_LEAST_ALIKE_OTHERS] * len(others)
    owner = assigned(people, boxes.astype(np.float64), np.array(rows).reshape(len(people), len(boxes)), least)
    place = owner.pop(0, None) if first else None
    return place, {box: row - first for row, box in owner.items()}


def _standing_free(boxes: Boxes) -> NDArray[np.bool_]:
    """Tell of each box whether no other covers it."""
    covering = overlap(boxes, boxes)
    np.fill_diagonal(covering, 0.0)
    return np.asarray(covering.max(axis=1, initial=0.0) < CROWDED)


def _with_sight(
    target: _Target, box: NDArray[np.float32], look: Appearance, alike: float, *, free: bool
) -> _Target:
    person = target.person.seen(box, look if free else None, _LEARN)
    usual = target.usual + _SMOOTHING_USUAL * (alike - target.usual) if free else target.usual
    return replace(target, person=person, usual=usual)


def _seen(other: _Other, box: NDArray[np.float32], look: Appearance | None) -> _Other:
    return replace(other, person=other.person.seen(box, look, _LEARN_OTHERS))


def _compared(other: _Other, alike: float, target: _Target, *, beside: bool) -> _Other:
    """Note how alike somebody who stands free is to the target."""

    def smoothed(before: float | None, share: float) -> float:
        return alike if before is None else before + share * (alike - before)

    agrees = target.lost and _agrees(alike, target)
    return replace(
        other,
        alike=smoothed(other.alike, _SMOOTHING),
        alike_beside=smoothed(other.alike_beside, _SMOOTHING_USUAL) if beside else other.alike_beside,
        agreed=other.agreed + 1 if agrees else 0,
    )


def _likeliest_other(
    place: int,
    alike: NDArray[np.float32],
    free: NDArray[np.bool_],
    theirs: dict[int, int],
    others: list[_Other],
) -> float:
    """Return how alike to the target somebody else is at most, now or of late; 0 if there is nobody.

    Who is not seen to stand free counts as remembered, who was as alike beside the target not at all.
    """
    now = [
        (float(alike[box]), others[theirs[box]] if box in theirs else None)
        for box in np.flatnonzero(free).tolist()
        if box != place
    ]
    of_late = [(other.alike, other) for other in others if other.alike is not None]
    return max(
        (alike for alike, other in (*now, *of_late) if other is None or _more_than_beside(alike, other)),
        default=0.0,
    )


def _is_elsewhere(target: _Target, here: float, likeliest: float) -> bool:
    """Tell whether the target is somebody else rather than who is in its place, `here` alike to it.

    A target that went where it could not have gone (pictures are missing, the camera was knocked) stands
    elsewhere as somebody new; whoever is where it must be is not it then, alike enough or not.
    """
    return not _agrees(here, target) and _agrees(likeliest, target) and likeliest > here + _MARGIN


def _agrees(alike: float, target: _Target) -> bool:
    """Tell whether somebody is as much alike to the target as it usually is itself."""
    return alike > target.usual - _DROP


def _more_than_beside(alike: float, other: _Other) -> bool:
    """Tell whether they are more alike to the target than they were beside it, if they ever were."""
    return other.alike_beside is None or alike > other.alike_beside + _MARGIN_BEFORE


def _taken_back(known: list[tuple[int, _Other]], target: _Target, free: NDArray[np.bool_]) -> int | None:
    """Return the place in `known` of whoever must be the lost target; None while nobody surely is."""
    ranked = sorted(
        ((other.alike, place) for place, (_, other) in enumerate(known) if other.alike is not None),
        reverse=True,
    )
    if not ranked:
        return None
    alike, place = ranked[0]
    next_best = ranked[1][0] if len(ranked) > 1 else 0.0
    box, other = known[place]
    before, now = target.person.box[None], other.person.box[None]
    tall = heights(before)[0]
    far = float(np.hypot(*(centres(now) - centres(before))[0])) / tall
    taller = heights(now)[0] / tall
    sure = (
        bool(free[box])
        and other.agreed >= _CONFIRM
        and _agrees(alike, target)
        and alike - next_best > _MARGIN
        and _more_than_beside(alike, other)
        and _OTHER_SIZE < taller < 1 / _OTHER_SIZE
        and far < _REACH + _REACH_PER_S * target.person.unseen_s
    )
    return place if sure else None
