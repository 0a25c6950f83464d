"""Segmenters: from a frame to an observation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import Box, MaskClass, Observation, at_size
from adatracker_deploy.perception.drawing import mask_shape

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Frame


class Segmenter(Protocol):
    """Finds the target, other people and obstacles in a frame."""

    needs_truth: bool
    """Whether it needs the ground truth that only simulated cameras send."""

    def reset(self) -> None:
        """Forget the target and all state, at the start of a trial."""

    def __call__(self, frame: Frame) -> Observation:
        """Segment one frame; frames come in the order of capture.

        Raises:
            PlatformError: it failed for good.
        """


class TruthSegmenter:
    """Returns a simulated camera's own class mask, no larger than any segmenter's."""

    needs_truth = True

    def reset(self) -> None:
        """Do nothing: it has no state."""

    def __call__(self, frame: Frame) -> Observation:
        """Return the ground truth.

        Raises:
            PlatformError: the frame comes from a real camera.
        """
        if frame.truth is None:
            raise PlatformError("this frame carries no truth: it does not come from a simulated camera")
        shape = frame.truth.mask.shape
        mask = at_size(frame.truth.mask, *map(min, shape, mask_shape(*shape)))
        box = Box.of_mask(frame.truth.mask)
        return Observation(mask, box, 1.0 if box else 0.0, frame.t_ns, frame.seq)


def check_observation(observation: Observation, frame: Frame) -> None:
    """Check that an observation can be of the frame; a segmenter may be faulty.

    Raises:
        PlatformError: it is of another frame, its mask holds invalid classes, or its box is invalid.
    """
    mask, box = observation.mask, observation.box
    if (observation.seq, observation.t_ns) != (frame.seq, frame.t_ns):
        raise PlatformError("segmenter: returned an observation of another frame")
    if mask.ndim != 2 or mask.dtype != np.uint8 or not mask.size or mask.max() > max(MaskClass):
        raise PlatformError("segmenter: returned an invalid class mask")
    if box is not None and not (0 < box.w <= 1 and 0 < box.h <= 1 and 0 <= box.cx <= 1 and 0 <= box.cy <= 1):
        raise PlatformError(f"segmenter: returned an invalid box: {box}")
    if not 0 <= observation.confidence <= 1:
        raise PlatformError(f"segmenter: returned a confidence of {observation.confidence}")
