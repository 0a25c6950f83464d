"""Segmenters: from a frame to an observation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import Box, MaskClass, Observation

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Frame


class Segmenter(Protocol):
    """Tells where the target, other people and obstacles are."""

    needs_truth: bool
    """Whether it reads the truth that only the cameras of rehearsals send."""

    def reset(self) -> None:
        """Forget the target, and all that was seen: a trial begins."""

    def __call__(self, frame: Frame) -> Observation:
        """Return what is in the frame; frames come one by one, in the order they were taken.

        Raises:
            PlatformError: it cannot tell, and will not be able to.
        """


class TruthSegmenter:
    """Takes the class mask that a simulated camera knows."""

    needs_truth = True

    def reset(self) -> None:
        """Do nothing: it remembers nothing."""

    def __call__(self, frame: Frame) -> Observation:
        """Return the truth.

        Raises:
            PlatformError: the frame comes from a real camera.
        """
        if frame.truth is None:
            raise PlatformError("this frame carries no truth: it does not come from a simulated camera")
        box = Box.of_mask(frame.truth.mask)
        return Observation(frame.truth.mask, box, 1.0 if box else 0.0, frame.t_ns, frame.seq)


def check_observation(observation: Observation, frame: Frame) -> None:
    """See that this can be an observation of the frame: whoever made it may be wrong.

    Raises:
        PlatformError: it is of another frame, its mask holds no classes, its box is no box.
    """
    mask, box = observation.mask, observation.box
    if (observation.seq, observation.t_ns) != (frame.seq, frame.t_ns):
        raise PlatformError("segmenter: gave an observation of another frame")
    if mask.ndim != 2 or mask.dtype != np.uint8 or not mask.size or mask.max() > max(MaskClass):
        raise PlatformError("segmenter: gave what is no class mask")
    if box is not None and not (0 < box.w <= 1 and 0 < box.h <= 1 and 0 <= box.cx <= 1 and 0 <= box.cy <= 1):
        raise PlatformError(f"segmenter: gave a box that is none: {box}")
    if not 0 <= observation.confidence <= 1:
        raise PlatformError(f"segmenter: gave a confidence of {observation.confidence}")
