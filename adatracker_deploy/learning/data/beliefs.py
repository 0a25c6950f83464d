"""What a policy would have been told at logged steps, by the functions that robots run."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.learning.data.shard import unpack_masks
from adatracker_deploy.learning.episode_spec import RATE_HZ
from adatracker_deploy.learning.tracking import ACTION
from adatracker_deploy.policy import belief

_CHUNK = 20_000
"""Masks that are unpacked at a time: 80 MB."""


OverTime = Callable[[NDArray[np.float32], NDArray[np.float32], float], NDArray[np.float32]]
"""`belief.over_time` or `response.over_time`."""


def told_over(
    over_time: OverTime,
    masks: NDArray[np.uint8],
    actions: NDArray[np.float32],
    first: NDArray[np.int64],
    length: NDArray[np.int64],
) -> NDArray[np.float32]:
    """Return what a policy that executed the logged actions would have been told, (T, W).

    Args:
        over_time: says what.
        masks: (T, P) uint8, packed, of all steps of all episodes.
        actions: (T, 2), executed.
        first: (E,), the step with which each episode begins.
        length: (E,), its number of steps.
    """
    parts = [
        belief.sight_of(unpack_masks(masks[begin : begin + _CHUNK]) == MaskClass.TARGET)
        for begin in range(0, len(masks), _CHUNK)
    ]
    sights, drives = np.concatenate(parts), belief.drive_of(actions, ACTION)
    # All episodes walk in step; those that are over repeat their last step, and are not read there.
    place = first + np.minimum(np.arange(length.max())[:, None], length - 1)
    told = over_time(sights[place], drives[place], 1.0 / RATE_HZ)
    exists = np.arange(length.max())[:, None] < length
    rows = np.empty((len(masks), told.shape[-1]), np.float32)
    rows[place[exists]] = told[exists]
    return rows
