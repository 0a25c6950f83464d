"""Search labels: what a cloned policy should do once the target has left its view.

The expert knows where the target went; a policy that sees no target does not, and one that walks past close
under a high camera leaves by either side almost alike. (Of 617 such gaps in states that a policy visited, the
side on which the target was last seen was the side that it went to in 59 of 100.) Cloned as it is, the
expert's turn averages to none: the policy hesitates for seconds. So, where the mask has been without a target
for `PATIENCE` steps and the expert turns as fast as it can, the clone turns as fast as it can to the side on
which the target was last seen, and goes on until it sees it again. That is a function of what the policy has
seen, so it can be learned; and a full turn one way has looked everywhere.

Ours, not the paper's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.learning.data.shard import unpack_masks
from adatracker_deploy.learning.episode_spec import MASK_SIZE

PATIENCE = 3
"""Steps without a target after which it counts as gone: dropped frames are shorter."""
_SATURATED = 0.98
"""A turn of the expert's from here on is as fast as it can: the target is far out of view."""
_CHUNK = 20_000
"""Masks that are unpacked at a time: 80 MB."""


def search_labels(
    masks: NDArray[np.uint8], experts: NDArray[np.float32], first: NDArray[np.int64]
) -> NDArray[np.float32]:
    """Return the experts' actions (T, 2) with the search in place of what a policy cannot know.

    Args:
        masks: (T, P) uint8, packed, of all steps of all episodes.
        experts: (T, 2) float32, forward and yaw, counter-clockwise positive.
        first: (T,) int64, for each step the step with which its episode begins.
    """
    steps = np.arange(len(masks))
    centre = target_centres(masks)
    last = np.maximum.accumulate(np.where(np.isnan(centre), -1, steps))  # the last step with a target
    ever = last >= first
    side = np.where(ever & (centre[last] > 0), np.float32(-1), np.float32(1))
    gone = steps - np.where(ever, last, first - 1) >= PATIENCE
    labels = experts.copy()
    searches = gone & (np.abs(experts[:, 1]) >= _SATURATED)
    labels[searches, 1] = side[searches]
    return labels


def target_centres(masks: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return the mean column (T,) of the target, pixels from the middle, right positive; NaN: no target."""
    columns = np.arange(MASK_SIZE, dtype=np.float32) - (MASK_SIZE - 1) / 2
    centres = np.full(len(masks), np.nan, np.float32)
    for begin in range(0, len(masks), _CHUNK):
        pixels = (unpack_masks(masks[begin : begin + _CHUNK]) == MaskClass.TARGET).sum(1, dtype=np.int32)
        count = pixels.sum(1)
        there = count > 0
        centres[begin : begin + _CHUNK][there] = (pixels[there] @ columns) / count[there]
    return centres
