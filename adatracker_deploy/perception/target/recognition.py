"""Who may be the target: the rules by which people in view are told from it, and by which it is taken back.

Crossing tracks may be swapped, so nobody is judged by their track alone: what counts is how alike they look
now, how alike they looked beside the target, and whether they hid it. Pure.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.perception.boxes import overlap, within
from adatracker_deploy.perception.target.appearance import likeness, stripes_known

if TYPE_CHECKING:
    from adatracker_deploy.perception.roles import Boxes
    from adatracker_deploy.perception.target.appearance import Appearance
    from adatracker_deploy.perception.target.motion import Motion
    from adatracker_deploy.perception.target.people import Person

COAST_S = 1.0
"""Time out of sight after which the target is lost."""
BRIDGED_S = 0.3
"""A target that is missed for no longer is where it is expected: detectors miss single pictures."""
_TELLING = 2
"""Stripes that a look must have to be kept, or to be recognised: many people have one in common."""
_VIEWS = 8
"""Looks that are kept of the target, the first one among them: back, front and sides, near and far. Of 24
rendered people 88 % of a new view's likenesses to eight of their own are above 99 % of others' likenesses to
those eight; 64 % with four, 56 % with one."""
_NEW_VIEW = 0.8
"""Likeness to all that are kept below which a look is another view."""
_CLEAR_S = 1.0
"""Time for which the target must have been seen, and stood free, before a view is kept: whom somebody has
just crossed may be somebody else."""
_LEARN = 0.05
"""Share of a new appearance blended into the target's known one."""
HIDING = 0.3
"""Share of the target's box from which on somebody else's covers it."""
_HIDDEN_S = 5.0
"""Time out of sight for which who hid the target is not taken for it. Tracks are swapped when people cross,
and then the target itself seems to have hidden the target. In rendered crowds (367 crossings) 5 s lose
nothing against for ever and 3 s do (5 wrong instead of 3); on street footage 8 s cost 2 % of success."""
_USUAL_ALIKE = 0.75
"""Similarity of a person to themselves from image to image: the median on street footage was 0.74."""
_SMOOTHING, _SMOOTHING_USUAL = 0.4, 0.1
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
_CLEARLY = 0.5
"""The detector's least score of who is taken back: of 2,425 rendered people who were, 2 % of the right ones
had less, and 19 % of the wrong ones."""
_TALLER, _NEARER_S = 1.4, 3.0
"""Height, as a multiple of the target's, from which on somebody is nearer than it was, and the time since it
last stood free within which they are not taken for it, if they came before it was lost: whoever comes
between is nearer, and the target does not come so much nearer unseen."""
_BEFORE, _BEFORE_S, _WHERE = 1.12, 0.5, 0.3
"""Height, as a multiple of the target's, from which on a box is that of who stands before it; the time for
which they may have been missed; and its least IoU with where they are expected. Of 2,424 rendered crossings,
half of them with somebody in the target's own body and clothes, 17 end on somebody else with this rule and
21 without."""
_CHANGED = 0.3
"""Rise of somebody's similarity to the target over the one beside it from which on their track is not on who
it was on: they crossed, and tracks are swapped when people cross. Of 190 people of PETS with jittered boxes,
three end on somebody else with this rule and five without."""
_SMOOTHING_HEIGHT, _ANEW_S = 0.3, 1.0
"""Share of a new height in the target's known one, and the time since it last stood free after which that
begins anew: half hidden it is lower, and with somebody in its box taller."""
_SPLIT_S = 3.0
"""Time after the choice in which it may turn out that the chosen box held two people."""
_OUTDONE = 5
"""Consecutive images in which the other of the two must look more like what was chosen."""


class Picture(NamedTuple):
    """What was found in a picture, of which the target may be one."""

    boxes: Boxes
    scores: NDArray[np.float32]
    looks: NDArray[np.float32]
    alike: NDArray[np.float32]
    """How alike each look is to the target's, shape (n,)."""
    chosen: NDArray[np.float32]
    """How alike each is to the look that was chosen, shape (n,)."""
    free: NDArray[np.bool_]
    """Whether each stands unoccluded, and is surely a person; only then an appearance is learnt."""


@dataclass(frozen=True, slots=True)
class Target:
    """Whom the operator chose: where they are, and how they look."""

    person: Person
    views: tuple[Appearance, ...]
    """The first look, and later ones that differ from all before; `_VIEWS` at most, none of fewer than
    `_TELLING` stripes."""
    usual: float = _USUAL_ALIKE
    """The target's usual similarity to itself."""
    clear_s: float = 0.0
    """Time for which the target has been seen and stood free."""
    since_s: float = 0.0
    """Time since it was chosen."""
    height: float = 0.0
    """Smoothed height of its boxes while it stood free, px, at the camera's present zoom."""
    free_s: float = 0.0
    """Time since it last stood free."""
    cut: bool = False
    """Whether the picture cut it off then: it may be taller."""

    @classmethod
    def chosen(cls, person: Person) -> Target:
        """Return somebody who has just become the target."""
        views = (person.look,) if stripes_known(person.look) >= _TELLING else ()
        return cls(person, views, height=person.height, cut=person.cut)

    @property
    def lost(self) -> bool:
        """Whether they have been out of sight for too long to be where they are expected."""
        return self.person.unseen_s > COAST_S

    def alike(self, looks: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the similarity of each appearance to the one of the target's that it is most like."""
        mine = [self.person.alike(looks), *(likeness(looks, view) for view in self.views)]
        return np.asarray(np.max(mine, axis=0), np.float32)

    def expected(self, motion: Motion, dt_s: float) -> Target:
        """Return the target predicted one image ahead."""
        person = self.person.expected(motion, dt_s)
        return replace(
            self,
            person=person,
            clear_s=self.clear_s + dt_s,
            since_s=self.since_s + dt_s,
            height=self.height * float(np.hypot(motion[0, 0], motion[1, 0])),
            free_s=self.free_s + dt_s,
        )

    def as_chosen(self, looks: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the similarity of each appearance to the one that was chosen; 0 if that told too little."""
        return likeness(looks, self.views[0]) if self.views else np.zeros(len(looks), np.float32)

    def seen(self, here: Picture, place: int) -> Target:
        """Return the predicted target updated with what is at `place`."""
        look, alike, free = here.looks[place], float(here.alike[place]), bool(here.free[place])
        person = self.person.seen(here.boxes[place], look, _LEARN if free else 0.0)
        if not free:
            return replace(self, person=person, clear_s=0.0)
        usual = self.usual + _SMOOTHING_USUAL * (alike - self.usual)
        views = self.views
        if stripes_known(look) >= _TELLING and (alike < _NEW_VIEW or not views) and self.clear_s >= _CLEAR_S:
            views = (*views[:1], *views[1:][2 - _VIEWS :], look)
        share = _SMOOTHING_HEIGHT if self.free_s < _ANEW_S else 1.0
        height = self.height + share * (person.height - self.height)
        return replace(
            self, person=person, usual=usual, views=views, height=height, free_s=0.0, cut=person.cut
        )

    def is_farther_than(self, person: Person) -> bool:
        """Return whether somebody is so much taller that they are nearer than it can be yet."""
        if self.cut or self.free_s > _NEARER_S:
            return False
        return person.height > _TALLER * max(self.height, self.person.height)


@dataclass(frozen=True, slots=True)
class Other:
    """Somebody else, and how alike to the target they are."""

    person: Person
    alike: float | None = None
    """Smoothed similarity to the target; None before the person was seen unoccluded."""
    alike_beside: float | None = None
    """The same while the target stood free beside them, and looked more like itself; None if it never did."""
    agreed: int = 0
    """Consecutive images in which the person looked like the target that is gone."""
    apart: bool = False
    """Whether they were seen in one picture with the target, and not in its place: then they are two."""
    hides: bool = False
    """Whether they stood apart from the target, and it then went out of sight behind them."""
    split: bool = False
    """Whether their first box overlapped the target's: before, both may have been in one."""
    late: bool = False
    """Whether they came when the target was lost already: then they do not stand between."""
    outdid: int = 0
    """Consecutive images in which they looked more like what was chosen than what is tracked did, both
    standing free."""

    def placed(self, target: Target, *, seen: bool) -> Other:
        """Note whether they stand apart from the target, which is `seen` or has just gone out of sight."""
        place = target.person.box.astype(np.float32)
        covers = within(place[None], self.person.box.astype(np.float32))[0] >= HIDING
        if seen:
            return replace(self, apart=self.apart or not covers)
        hides = covers and self.apart and target.person.unseen_s <= BRIDGED_S
        return replace(self, hides=self.hides or bool(hides))

    def compared(self, alike: float, target: Target, *, beside: bool) -> Other:
        """Update their similarity to the target; they stand free."""

        def smoothed(before: float | None, share: float) -> float:
            return alike if before is None else before + share * (alike - before)

        # Whoever was there beside the target is somebody else until it is lost; who came since may be it.
        gone = target.lost if self.apart else target.person.unseen_s > 0.0
        agrees = gone and _agrees(alike, target)
        return replace(
            self,
            alike=smoothed(self.alike, _SMOOTHING),
            alike_beside=smoothed(self.alike_beside, _SMOOTHING_USUAL) if beside else self.alike_beside,
            agreed=self.agreed + 1 if agrees else 0,
        )

    def rivals(self, margin: float) -> Other:
        """Note by how much more they look like what was chosen than what is tracked; both stand free."""
        return replace(self, outdid=self.outdid + 1 if margin > _MARGIN else 0)

    def may_be(self, alike: float, target: Target) -> bool:
        """Return whether they may be it: they did not hide it, or have changed since; are not much nearer;
        and look more like it than beside it."""
        if self.hides and target.person.unseen_s <= _HIDDEN_S and not self._has_changed(alike):
            return False
        if not self.late and target.is_farther_than(self.person):
            return False
        return self.alike_beside is None or alike > self.alike_beside + _MARGIN_BEFORE

    def _has_changed(self, alike: float) -> bool:
        """Return whether they look so much more like it than beside it that tracks were swapped."""
        changed = self.alike_beside is not None and alike > self.alike_beside + _CHANGED
        return changed and self.agreed >= _CONFIRM


def is_elsewhere(
    target: Target, here: Picture, place: int, others: list[Other], theirs: dict[int, int]
) -> bool:
    """Return whether another detection is the target rather than the one at its predicted box, `place`.

    After dropped frames or a knock on the camera, the target may reappear as a new track; then reject the
    detection at its predicted box, however similar. While the target has just stood free, so that no tracks
    can have been swapped, who looks more like who they were than like the target is themselves: a target that
    turns round beside somebody keeps its place.
    """
    alike = float(here.alike[place])
    likeliest = _likeliest_other(target, here, place, others, theirs)
    return not _agrees(alike, target) and _agrees(likeliest, target) and likeliest > alike + _MARGIN


def who_stands_before(
    target: Target, box: NDArray[np.float32], others: list[Other], theirs: dict[int, int]
) -> int | None:
    """Return the index in `others` of whose box this is rather than the target's; None if nobody's.

    Who stands before it is seen, and it may not be. So a box that is taller than the target, and lies rather
    where somebody else is expected who has no other box, is theirs, however like the target it looks: a look
    of one moment is more like one of the target's many than like what is known of them.
    """
    if box[3] - box[1] < _BEFORE * target.height:
        return None
    where = np.array([target.person.box, *(other.person.box for other in others)], np.float32)
    mine, *shared = overlap(box[None], where)[0].tolist()
    for index, (other, share) in enumerate(zip(others, shared, strict=True)):
        missed = index not in theirs.values() and other.person.unseen_s <= _BEFORE_S
        if missed and other.apart and share >= max(_WHERE, mine):
            return index
    return None


def _likeliest_other(
    target: Target, here: Picture, place: int, others: list[Other], theirs: dict[int, int]
) -> float:
    """Return the highest similarity of anybody else to the target, now or smoothed; 0 if there is nobody.

    Occluded people use their smoothed similarity; people who cannot be the target do not count.
    """
    elsewhere = [row for row in np.flatnonzero(here.free).tolist() if row != place]
    tracked = {row: others[theirs[row]].person for row in elsewhere if row in theirs}
    themselves = {
        theirs[row]
        for row, person in tracked.items()
        if target.free_s <= BRIDGED_S and person.alike(here.looks[row][None])[0] > here.alike[row]
    }
    now = [(float(here.alike[row]), theirs.get(row)) for row in elsewhere]
    of_late = [(other.alike, index) for index, other in enumerate(others) if other.alike is not None]
    return max(
        (
            alike
            for alike, index in (*now, *of_late)
            if index is None or (index not in themselves and others[index].may_be(alike, target))
        ),
        default=0.0,
    )


def _agrees(alike: float, target: Target) -> bool:
    """Return whether somebody is about as similar to the target as it usually is to itself."""
    return alike > min(target.usual - _DROP, _SURELY)


def outdone(known: list[tuple[int, Other]], target: Target) -> int | None:
    """Return the index in `known` of who was chosen, if that is not who is tracked.

    A box may hold two people. When it splits, its place may go on with one of them and what was chosen look
    like the other.
    """
    if target.since_s > _SPLIT_S:
        return None
    rivals = [place for place, (_, other) in enumerate(known) if other.split and other.outdid >= _OUTDONE]
    return max(rivals, key=lambda place: known[place][1].outdid, default=None)


def taken_back(known: list[tuple[int, Other]], target: Target, here: Picture) -> int | None:
    """Return the index in `known` of the target that was gone; None while nobody is certain.

    Who cannot be the target is no rival of who may be it.
    """
    ranked = sorted(
        (
            (other.alike, place)
            for place, (_, other) in enumerate(known)
            if other.alike is not None and other.may_be(other.alike, target)
        ),
        reverse=True,
    )
    if not ranked:
        return None
    alike, place = ranked[0]
    next_best = ranked[1][0] if len(ranked) > 1 else 0.0
    box, other = known[place]
    sure = (
        bool(here.free[box])
        and float(here.scores[box]) >= _CLEARLY
        and stripes_known(other.person.look) >= _TELLING
        and other.agreed >= _CONFIRM
        and _agrees(alike, target)
        and alike - next_best > _MARGIN
    )
    return place if sure else None
