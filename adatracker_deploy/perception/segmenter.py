"""Segmenters: from a frame to an observation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from adatracker_deploy.messages import Box, Observation

if TYPE_CHECKING:
    from adatracker_deploy.messages import Frame


class Segmenter(Protocol):
    """Tells where the target, other people and obstacles are."""

    def __call__(self, frame: Frame) -> Observation:
        """Return what is in the frame."""


def segment_truth(frame: Frame) -> Observation:
    """Take the class mask that a simulated camera knows.

    Raises:
        ValueError: the frame comes from a real camera.
    """
    if frame.truth is None:
        raise ValueError("this frame carries no truth: it does not come from a simulated camera")
    box = Box.of_mask(frame.truth.mask)
    return Observation(frame.truth.mask, box, 1.0 if box else 0.0, frame.t_ns, frame.seq)
