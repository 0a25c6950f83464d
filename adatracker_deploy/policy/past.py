"""What a policy is told of its past: the belief across gaps and the response of the body, as far as it wants.

Both follow from the same sights and the same commands, so they walk together: one robot's, a batch of
episodes', or all of a data set's. Training, export, evaluation, rehearsals and robots all come through here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.policy import belief, response, search
from adatracker_deploy.policy.belief import Array

if TYPE_CHECKING:
    from adatracker_deploy.policy.base import ActionSpec


class Told(NamedTuple):
    """What a network reads, float32; what it is not told has no columns."""

    belief: Array
    """(..., `belief.SIZE`)."""
    response: Array
    """(..., `response.SIZE`)."""


class Past:
    """The past of one robot, or of E episodes that are stepped together."""

    def __init__(self, *shape: int, believes: bool, responds: bool, period_s: float) -> None:
        """Begin with nothing seen and nothing commanded.

        Args:
            shape: leading dimensions of everything here; none for one robot, E for E episodes.
            believes: the belief across gaps is told.
            responds: the response of the body is told.
            period_s: between two pictures.
        """
        self._shape = shape
        self._period_s = period_s
        self._no_belief = belief.initial(*shape) if believes else None
        self._no_response = response.initial(*shape, period_s=period_s) if responds else None
        self._belief, self._response = self._no_belief, self._no_response

    def forget(self, where: NDArray[np.bool_] | None = None) -> None:
        """Begin anew, everywhere or in the episodes (E,) where it is true."""
        if where is None:
            self._belief, self._response = self._no_belief, self._no_response
            return
        if self._belief is not None and self._no_belief is not None:
            self._belief = np.where(where[:, None], self._no_belief, self._belief)
        if self._response is not None and self._no_response is not None:
            self._response = response.kept_where(~where, self._response, self._no_response)

    def see(self, target: NDArray[np.bool_], values: Array, action: ActionSpec) -> Told:
        """Go on by one picture and return what a network reads then; what it is not told is not computed.

        Args:
            target: which pixels are the target's, (..., S, S).
            values: the action that was executed since the picture before, (..., A); zeros at first.
            action: its axes; forward and yaw are among them where anything is told.
        """
        if self._belief is not None or self._response is not None:
            self.look(belief.sight_of(target), belief.drive_of(values, action))
        return self.told()

    def look(self, sight: Array, drive: Array) -> None:
        """Go on by one picture.

        Args:
            sight: of this picture, (..., `len(belief.SIGHT)`).
            drive: commanded since the one before, (..., 2): forward and yaw, fractions of the limits.
        """
        if self._belief is not None:
            self._belief = belief.advance(self._belief, sight, drive, self._period_s)
        if self._response is not None:
            self._response = response.advance(self._response, sight, drive, self._period_s)

    def search_yaw(self) -> Array:
        """Return the yaw (...) with which to search, as `search.search_yaw`; 0 where nothing is believed."""
        return np.zeros(self._shape, np.float32) if self._belief is None else search.search_yaw(self._belief)

    def told(self) -> Told:
        """Return what a network reads after the last picture."""
        nothing = np.zeros((*self._shape, 0), np.float32)
        return Told(
            nothing if self._belief is None else belief.told(self._belief),
            nothing if self._response is None else response.told(self._response, self._period_s),
        )


def over_time(sights: Array, drives: Array, *, believes: bool, responds: bool, period_s: float) -> Told:
    """Return what a network is told at each step of one or more episodes, from their start.

    Args:
        sights: (T, ..., `len(belief.SIGHT)`), T at least 1.
        drives: (T, ..., 2), what was commanded at each step; the last one does not matter.
        believes: as for `Past`, as the rest.
        responds: likewise.
        period_s: likewise.

    Returns:
        Arrays of shape (T, ..., columns).
    """
    past = Past(*sights.shape[1:-1], believes=believes, responds=responds, period_s=period_s)
    drive, steps = np.zeros_like(drives[0]), []
    for sight, following in zip(sights, drives, strict=True):
        past.look(sight, drive)
        steps.append(past.told())
        drive = following
    beliefs, responses = zip(*steps, strict=True)
    return Told(np.stack(beliefs), np.stack(responses))
