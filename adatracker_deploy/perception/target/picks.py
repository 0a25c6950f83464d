"""Choosing again: whom the operator has clicked on becomes the target.

A click belongs to the picture that the operator saw, which is some tenths of a second old by then. So the
lock is started anew in that picture and then takes the pictures since: whoever walks on is followed from
where they were clicked on. Times come with the pictures; the same pictures and clicks give the same results.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.perception.target.choice import Choice
from adatracker_deploy.perception.target.lock import Locked, TargetLock

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Click
    from adatracker_deploy.perception.roles import Boxes
    from adatracker_deploy.perception.target.motion import Motion

REMEMBERED_S = 2.0
"""Age of the oldest picture in which a click can find somebody."""


class Sighting(NamedTuple):
    """Everybody in one picture, as the lock takes them."""

    seq: int
    t_ns: int
    boxes: Boxes
    scores: NDArray[np.float32]
    looks: NDArray[np.float32]
    motion: Motion


class Picked(NamedTuple):
    """The new target."""

    lock: TargetLock
    """On them, as if they had been chosen in the picture that was clicked."""
    locked: Locked
    """Its result for the newest picture."""
    box: NDArray[np.float32]
    """Their box in the picture that was clicked, px, shape (4,)."""


class RecentPeople:
    """Remembers the people of the last `REMEMBERED_S`."""

    def __init__(self) -> None:
        self._sightings: deque[Sighting] = deque()

    def add(self, sighting: Sighting) -> None:
        """Take the next picture's people."""
        self._sightings.append(sighting)
        while sighting.t_ns - self._sightings[0].t_ns > REMEMBERED_S * 1e9:
            self._sightings.popleft()

    def locked_on(self, click: Click, width: int, height: int) -> Picked | None:
        """Return a lock on the person at the clicked point; None where nobody is.

        They are looked for in the picture that was clicked, then in the newest: a detector misses single
        pictures. Of several, the one whose centre is nearest is meant.

        Args:
            click: the operator's.
            width: of the pictures, px.
            height: of the pictures, px.
        """
        clicked = [at for at, sighting in enumerate(self._sightings) if sighting.seq == click.seq]
        choice, scale = Choice(numbers=(click.x, click.y)), np.array([width, height] * 2, np.float32)
        for at in (*clicked, len(self._sightings) - 1):
            seen, *since = list(self._sightings)[at:]
            place = choice(np.asarray(seen.boxes / scale, np.float32), seen.scores)
            if place is None:
                continue
            lock = TargetLock()
            locked = lock.choose(place, seen.boxes, seen.looks, seen.t_ns)
            for later in since:
                locked = lock.update(later.boxes, later.scores, later.looks, later.motion, later.t_ns)
            return Picked(lock, locked, seen.boxes[place])
        return None
