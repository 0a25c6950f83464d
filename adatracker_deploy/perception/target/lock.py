"""The target lock: finds the chosen person among the boxes of each image (re-identification).

The target is tracked by predicted position and appearance, together with everybody else in view: all tracks
compete for the boxes. A target out of sight for too long is lost. It is reacquired only by a person who is
similar to the target, more similar than everybody else, and more similar than that person was while beside
the target; who hid it is not taken for it. Until then there is no target. Time is passed in; the same images
give the same results.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.messages import TargetState
from adatracker_deploy.perception.boxes import overlap, within
from adatracker_deploy.perception.target.appearance import is_cut, likeness, stripes_known
from adatracker_deploy.perception.target.people import Person, assigned

if TYPE_CHECKING:
    from adatracker_deploy.perception.roles import Boxes
    from adatracker_deploy.perception.target.appearance import Appearance
    from adatracker_deploy.perception.target.motion import Motion

COAST_S = 1.0
"""Time out of sight after which the target is lost."""
BRIDGED_S = 0.3
"""A target that is missed for no longer is where it is expected: detectors miss single pictures."""
_TAKEN = 0.3
"""IoU with somebody's box from which on the target is not expected there, but behind them."""
_HIDING = 0.3
"""Share of the target's box from which on somebody else's covers it."""
_HIDDEN_S = 5.0
"""Time out of sight for which who hid the target is not taken for it. Tracks are swapped when people cross,
and then the target itself seems to have hidden the target. In rendered crowds (367 crossings) 5 s lose
nothing against for ever and 3 s do (5 wrong instead of 3); on street footage 8 s cost 2 % of success."""
FORGET_S = 2.0
"""Time out of sight after which another person's track is deleted."""
CROWDED = 0.1
"""IoU with another box above which an appearance is not trusted or learnt."""
_NEW_SCORE = 0.45
"""Least score of an unmatched box that starts a new track."""
_SAME, _NESTED = 0.5, 0.85
"""IoU with the target's box, and share of the smaller one within the other, from which on an unmatched box is
a second one on the target and starts no track, which would take the target's next box for its own."""
_LEAST_ALIKE, _LEAST_ALIKE_OTHERS = 0.5, 0.4
_LEARN, _LEARN_OTHERS = 0.05, 0.1
"""Share of a new appearance blended into the known one."""
_USUAL_ALIKE = 0.75
"""Similarity of a person to themselves from image to image: the median on street footage was 0.74."""
_SMOOTHING, _SMOOTHING_USUAL = 0.4, 0.1
_VIEWS = 8
"""Looks that are kept of the target, the first one among them: back, front and sides, near and far. Of 24
rendered people 88 % of a new view's likenesses to eight of their own are above 99 % of others' likenesses to
those eight; 64 % with four, 56 % with one."""
_TELLING = 2
"""Stripes that a look must have to be kept, or to be recognised: many people have one in common."""
_NEW_VIEW = 0.8
"""Likeness to all that are kept below which a look is another view."""
_CLEAR_S = 1.0
"""Time for which the target must have been seen, and stood free, before a view is kept: whom somebody has
just crossed may be somebody else."""

_DROP, _SURELY = 0.1, 0.75
"""Largest drop of a reacquired person's similarity below the usual one; and a similarity that is enough
whatever is usual, which is high for a target that is seen from one side only. Of 24 rendered people 93 % of
new views were as similar as that to eight of their own, and 2 % of others'."""
_MARGIN = 0.03
"""Required margin over the second most similar person."""
_MARGIN_BEFORE = 0.06
"""Required margin over that person's own similarity beside the target: crossing tracks may have been
swapped."""
_CONFIRM = 3
"""Consecutive images that must agree."""


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


@dataclass(frozen=True, slots=True)
class _Target:
    person: Person
    views: tuple[Appearance, ...]
    """The first look, and later ones that differ from all before; `_VIEWS` at most, none of fewer than
    `_TELLING` stripes."""
    usual: float = _USUAL_ALIKE
    """The target's usual similarity to itself."""
    clear_s: float = 0.0
    """Time for which the target has been seen and stood free."""

    @property
    def lost(self) -> bool:
        return self.person.unseen_s > COAST_S

    def alike(self, looks: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the similarity of each appearance to the one of the target's that it is most like."""
        mine = [self.person.alike(looks), *(likeness(looks, view) for view in self.views)]
        return np.asarray(np.max(mine, axis=0), np.float32)


@dataclass(frozen=True, slots=True)
class _Other:
    person: Person
    alike: float | None = None
    """Smoothed similarity to the target; None before the person was seen unoccluded."""
    alike_beside: float | None = None
    """The same while the target stood free beside them, and looked more like itself; None if it never did."""
    agreed: int = 0
    """Consecutive images in which the person looked like the lost target."""
    apart: bool = False
    """Whether they were seen in one picture with the target, and not in its place: then they are two."""
    hides: bool = False
    """Whether they stood apart from the target, and it then went out of sight behind them."""


class _Picture(NamedTuple):
    """What was found in a picture, of which the target may be one."""

    boxes: Boxes
    scores: NDArray[np.float32]
    looks: NDArray[np.float32]
    alike: NDArray[np.float32]
    """How alike each look is to the target's, shape (n,)."""
    free: NDArray[np.bool_]
    """Whether each stands unoccluded, and is surely a person; only then an appearance is learnt."""


class TargetLock:
    """Tracks one person; call `choose` before `update`."""

    def __init__(self) -> None:
        self._target: _Target | None = None
        self._others: list[_Other] = []
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
        self._target = _Target(target, (target.look,) if stripes_known(target.look) >= _TELLING else ())
        self._others = [_Other(person) for person in everybody]
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
                continue the track of a target that is in none of the first (Zhang et al. 2022, "ByteTrack:
                multi-object tracking by associating every detection box").

        Raises:
            RuntimeError: nobody has been chosen.
        """
        if self._target is None:
            raise RuntimeError("no target has been chosen")
        dt_s, self._t_ns = max(0.0, (t_ns - self._t_ns) / 1e9), t_ns
        was_lost = self._target.lost
        target = self._target
        target = replace(target, person=target.person.expected(motion, dt_s), clear_s=target.clear_s + dt_s)
        others = [replace(other, person=other.person.expected(motion, dt_s)) for other in self._others]
        alike = target.alike(looks)
        rows = list(range(len(boxes)))[:sure]
        place, theirs = _places(None if was_lost else target, others, boxes[rows], looks[rows], alike[rows])
        faint = None if was_lost or place is not None else _faintly(target, boxes, looks, alike, len(rows))
        if faint is not None:
            rows, place = [*rows, faint], len(rows)
        free = _standing_free(boxes[rows])
        free[len(boxes[:sure]) :] = False
        here = _Picture(boxes[rows], scores[rows], looks[rows], alike[rows], free)
        if place is not None and _is_elsewhere(target, here, place, others, theirs):
            place = None
        target = replace(target, clear_s=0.0) if place is None else _with_sight(target, here, place)
        known = _others_in(here, others, theirs, target, place)
        unseen = [other for row, other in enumerate(others) if row not in theirs.values()]
        again = _taken_back(known, target, here.free) if was_lost else None
        if again is not None:
            place, found = known.pop(again)
            target = replace(target, person=found.person)
        self._target = target
        self._others = [other for _, other in known]
        self._others += [other for other in unseen if other.person.unseen_s <= FORGET_S]
        if place is None:
            state = TargetState.LOST if target.lost else TargetState.COASTING
            return Locked(state, None, 0.0, _expected(target, here.boxes))
        state = TargetState.REACQUIRED if was_lost else TargetState.TRACKED
        return Locked(state, rows[place], float(here.alike[place]))


def _expected(target: _Target, boxes: Boxes) -> tuple[float, float, float, float] | None:
    """Return where a target that has just been missed is, unless somebody else was found there."""
    box = target.person.box.astype(np.float32)
    if target.person.unseen_s > BRIDGED_S or overlap(box[None], boxes).max(initial=0.0) >= _TAKEN:
        return None
    left, top, right, bottom = box.tolist()
    return left, top, right, bottom


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
    cut = np.array([is_cut(look) for look in looks], bool)
    shares = np.array(rows).reshape(len(people), len(boxes))
    owner = assigned(people, boxes.astype(np.float64), shares, least, cut)
    place = owner.pop(0, None) if first else None
    return place, {box: row - first for row, box in owner.items()}


def _faintly(
    target: _Target, boxes: Boxes, looks: NDArray[np.float32], alike: NDArray[np.float32], sure: int
) -> int | None:
    """Return which of the boxes after the first `sure` ones is the target's; None if none is, or it is
    somebody's."""
    place, _ = _places(target, [], boxes[sure:], looks[sure:], alike[sure:])
    if place is None or overlap(boxes[sure + place][None], boxes[:sure]).max(initial=0.0) >= _TAKEN:
        return None
    return sure + place


def _standing_free(boxes: Boxes) -> NDArray[np.bool_]:
    """Return for each box whether it is unoccluded."""
    covering = overlap(boxes, boxes)
    np.fill_diagonal(covering, 0.0)
    return np.asarray(covering.max(axis=1, initial=0.0) < CROWDED)


def _with_sight(target: _Target, here: _Picture, place: int) -> _Target:
    look, alike, free = here.looks[place], float(here.alike[place]), bool(here.free[place])
    person = target.person.seen(here.boxes[place], look, _LEARN if free else 0.0)
    if not free:
        return replace(target, person=person, clear_s=0.0)
    usual = target.usual + _SMOOTHING_USUAL * (alike - target.usual)
    views = target.views
    if stripes_known(look) >= _TELLING and (alike < _NEW_VIEW or not views) and target.clear_s >= _CLEAR_S:
        views = (*views[:1], *views[1:][2 - _VIEWS :], look)
    return replace(target, person=person, usual=usual, views=views)


def _others_in(
    here: _Picture, others: list[_Other], theirs: dict[int, int], target: _Target, place: int | None
) -> list[tuple[int, _Other]]:
    """Return everybody but the target, which is at `place`, with their boxes' numbers."""
    beside = None if place is None or not here.free[place] else float(here.alike[place])
    mine = target.person.box.astype(np.float32)
    known: list[tuple[int, _Other]] = []
    for box, (where, score, look, alike, free) in enumerate(zip(*here, strict=True)):
        if box == place:
            continue
        if box in theirs:
            other = others[theirs[box]]
            other = replace(other, person=other.person.seen(where, look, _LEARN_OTHERS if free else 0.0))
            other = _placed(other, target, seen=place is not None)
        elif score >= _NEW_SCORE and (place is None or not _is_second(where, mine)):
            other = _Other(Person.new(where, look))
        else:
            continue
        if free:
            sure = beside is not None and float(alike) <= beside
            other = _compared(other, float(alike), target, beside=sure)
        known.append((box, other))
    return known


def _is_second(box: NDArray[np.float32], mine: NDArray[np.float32]) -> bool:
    """Return whether a box is a second one on the target, whose box is `mine`."""
    nested = max(within(box[None], mine)[0], within(mine[None], box)[0])
    return bool(overlap(box[None], mine[None])[0, 0] >= _SAME and nested >= _NESTED)


def _placed(other: _Other, target: _Target, *, seen: bool) -> _Other:
    """Note whether a person stands apart from the target, which is `seen` or has just gone out of sight."""
    place = target.person.box.astype(np.float32)
    covers = within(place[None], other.person.box.astype(np.float32))[0] >= _HIDING
    if seen:
        return replace(other, apart=other.apart or not covers)
    hides = covers and other.apart and target.person.unseen_s <= BRIDGED_S
    return replace(other, hides=other.hides or bool(hides))


def _compared(other: _Other, alike: float, target: _Target, *, beside: bool) -> _Other:
    """Update an unoccluded person's similarity to the target."""

    def smoothed(before: float | None, share: float) -> float:
        return alike if before is None else before + share * (alike - before)

    agrees = target.lost and _agrees(alike, target)
    return replace(
        other,
        alike=smoothed(other.alike, _SMOOTHING),
        alike_beside=smoothed(other.alike_beside, _SMOOTHING_USUAL) if beside else other.alike_beside,
        agreed=other.agreed + 1 if agrees else 0,
    )


def _is_elsewhere(
    target: _Target, here: _Picture, place: int, others: list[_Other], theirs: dict[int, int]
) -> bool:
    """Return whether another detection is the target rather than the one at its predicted box, `place`.

    After dropped frames or a knock on the camera, the target may reappear as a new track; then reject the
    detection at its predicted box, however similar.
    """
    alike = float(here.alike[place])
    likeliest = _likeliest_other(target, here, place, others, theirs)
    return not _agrees(alike, target) and _agrees(likeliest, target) and likeliest > alike + _MARGIN


def _likeliest_other(
    target: _Target, here: _Picture, place: int, others: list[_Other], theirs: dict[int, int]
) -> float:
    """Return the highest similarity of anybody else to the target, now or smoothed; 0 if there is nobody.

    Occluded people use their smoothed similarity; people who cannot be the target do not count.
    """
    elsewhere = [row for row in np.flatnonzero(here.free).tolist() if row != place]
    now = [(float(here.alike[row]), others[theirs[row]] if row in theirs else None) for row in elsewhere]
    of_late = [(other.alike, other) for other in others if other.alike is not None]
    return max(
        (alike for alike, other in (*now, *of_late) if other is None or _may_be(other, alike, target)),
        default=0.0,
    )


def _agrees(alike: float, target: _Target) -> bool:
    """Return whether somebody is about as similar to the target as it usually is to itself."""
    return alike > min(target.usual - _DROP, _SURELY)


def _may_be(other: _Other, alike: float, target: _Target) -> bool:
    """Return whether they may be the target: they did not hide it, and look more like it than beside it."""
    if other.hides and target.person.unseen_s <= _HIDDEN_S:
        return False
    return other.alike_beside is None or alike > other.alike_beside + _MARGIN_BEFORE


def _taken_back(known: list[tuple[int, _Other]], target: _Target, free: NDArray[np.bool_]) -> int | None:
    """Return the index in `known` of the reacquired target; None while nobody is certain.

    Who cannot be the target is no rival of who may be it.
    """
    ranked = sorted(
        (
            (other.alike, place)
            for place, (_, other) in enumerate(known)
            if other.alike is not None and _may_be(other, other.alike, target)
        ),
        reverse=True,
    )
    if not ranked:
        return None
    alike, place = ranked[0]
    next_best = ranked[1][0] if len(ranked) > 1 else 0.0
    box, other = known[place]
    sure = (
        bool(free[box])
        and stripes_known(other.person.look) >= _TELLING
        and other.agreed >= _CONFIRM
        and _agrees(alike, target)
        and alike - next_best > _MARGIN
    )
    return place if sure else None
