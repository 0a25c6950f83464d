"""What a policy would have been told at logged steps, by the functions that robots run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.learning.data.shard import unpack_masks
from adatracker_deploy.learning.episode_spec import RATE_HZ
from adatracker_deploy.learning.tracking import ACTION
from adatracker_deploy.policy import belief
from adatracker_deploy.policy.past import Told, over_time

_CHUNK = 20_000
"""Masks that are unpacked at a time: 80 MB."""


def told_at_steps(
    masks: NDArray[np.uint8],
    actions: NDArray[np.float32],
    first: NDArray[np.int64],
    length: NDArray[np.int64],
    *,
    believes: bool,
    responds: bool,
) -> Told:
    """Return what a policy that executed the logged actions would have been told, arrays (T, columns).

    Args:
        masks: (T, P) uint8, packed, of all steps of all episodes.
        actions: (T, 2), executed.
        first: (E,), the step with which each episode begins.
        length: (E,), its number of steps.
        believes: as for `policy.past.Past`.
        responds: likewise.
    """
    parts = [
        belief.sight_of(unpack_masks(masks[begin : begin + _CHUNK]) == MaskClass.TARGET)
        for begin in range(0, len(masks), _CHUNK)
    ]
    sights, drives = np.concatenate(parts), belief.drive_of(actions, ACTION)
    # All episodes walk in step; those that are over repeat their last step, and are not read there.
    along = np.arange(length.max())[:, None]
    place = first + np.minimum(along, length - 1)
    told = over_time(
        sights[place], drives[place], believes=believes, responds=responds, period_s=1.0 / RATE_HZ
    )
    exists = along < length

    def at_steps(values: NDArray[np.float32]) -> NDArray[np.float32]:
        rows = np.empty((len(masks), values.shape[-1]), np.float32)
        rows[place[exists]] = values[exists]
        return rows

    return Told(*map(at_steps, told))
