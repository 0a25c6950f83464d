"""The segmenter for real images: a detector, the target lock and a mask head.

Pure but for its state: the same frames, in the same order, always give the same observations.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.core.messages import Box, MaskClass, Observation
from adatracker_deploy.perception.boxes import heights
from adatracker_deploy.perception.drawing import MASK_SIZE, class_mask, ellipses
from adatracker_deploy.perception.roles import Instances
from adatracker_deploy.perception.target.appearance import appearances
from adatracker_deploy.perception.target.choice import Choice
from adatracker_deploy.perception.target.lock import Locked, TargetLock
from adatracker_deploy.perception.target.motion import CameraMotion
from adatracker_deploy.perception.target.propagation import Propagation, resized

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from adatracker_deploy.core.messages import Frame
    from adatracker_deploy.perception.roles import Detector, MaskHead, Masks, Propagator

PERSON = "person"
LEAST_OBSTACLE_SCORE = 0.5
CUT_OUT = 2
"""Number of people with masks from the mask head: the target and the nearest others; each costs
milliseconds."""
WORTH_CUTTING_OUT = 0.25
"""Share of the image height below which other people are drawn as ellipses; few px are wrong then."""


class TargetSegmenter:
    """Implements `Segmenter`.

    Args:
        detector: of people and, by any other word, of obstacles.
        mask_head: cuts people out; needed where the detector gives boxes alone.
        choice: who becomes the target, in the first frame in which there is such a person.
        propagator: follows the target's mask, also where the detector misses the target.
        key_frames: do not ask the detector while the propagator sees the target and the lock agreed in the
            picture before: for slow detectors. Nobody else and no obstacle is known in between.
    """

    needs_truth = False

    def __init__(
        self,
        detector: Detector,
        mask_head: MaskHead | None,
        choice: Choice | None = None,
        propagator: Propagator | None = None,
        *,
        key_frames: bool = False,
    ) -> None:
        self._detector = detector
        self._mask_head = mask_head
        self._choice = choice or Choice()
        self._propagation = Propagation(propagator) if propagator else None
        self._key_frames = key_frames
        self.reset()

    def reset(self) -> None:
        """Forget the target: the next frame with such a person chooses anew."""
        self._lock = TargetLock()
        self._motion = CameraMotion()
        self._chosen = False
        if self._propagation:
            self._propagation.reset()

    def __call__(self, frame: Frame) -> Observation:
        """Return what is in the frame; one after the other, in the order they were taken.

        Raises:
            PlatformError: the model gave what no such model gives.
        """
        followed = self._propagation.step(frame.rgb) if self._propagation else None
        between = self._key_frames and followed is not None and followed.trusted
        found = Instances.none() if between else self._detector(frame.rgb)
        kinds = np.array([word == PERSON for word in found.words], bool)
        people = found.only(np.flatnonzero(kinds))
        obstacles = found.only(np.flatnonzero(~kinds & (found.scores >= LEAST_OBSTACLE_SCORE)))
        if followed:
            people = followed.among(people, PERSON)
        locked = self._locked(frame, people)
        place = locked.place if locked else None
        mask = self._drawn(frame, people, obstacles, place)
        return Observation(
            mask=mask,
            box=None if place is None else _fractions(people.boxes[place], frame),
            confidence=locked.likeness if locked else 0.0,
            t_ns=frame.t_ns,
            seq=frame.seq,
            target=locked.state if locked else None,
        )

    def _locked(self, frame: Frame, people: Instances) -> Locked | None:
        """Return what the lock says; None while nobody has been chosen."""
        height, width = frame.rgb.shape[:2]
        looks = appearances(frame.rgb, people.boxes)
        motion = self._motion(frame.rgb, people.boxes)
        if self._chosen:
            return self._lock.update(people.boxes, people.scores, looks, motion, frame.t_ns)
        place = self._choice(people, width, height)
        if place is None:
            return None
        self._chosen = True
        return self._lock.choose(place, people.boxes, looks, frame.t_ns)

    def _drawn(
        self, frame: Frame, people: Instances, obstacles: Instances, target: int | None
    ) -> NDArray[np.uint8]:
        height, width = frame.rgb.shape[:2]
        values = [MaskClass.PERSON] * len(people) + [MaskClass.OBSTACLE] * len(obstacles)
        if target is not None:
            values[target] = MaskClass.TARGET
        masks = [*self._people_masks(frame, people, target), *_obstacle_masks(obstacles, width, height)]
        # A box is larger than its object: an obstacle without a mask never hides anybody.
        obstacle_bottoms = (
            obstacles.boxes[:, 3] if obstacles.masks is not None else np.zeros(len(obstacles), np.float32)
        )
        bottoms = np.concatenate((people.boxes[:, 3], obstacle_bottoms))
        return class_mask(masks, values, bottoms)

    def _people_masks(self, frame: Frame, people: Instances, target: int | None) -> Masks:
        if self._propagation is None or target is None:
            return self._cut_out(frame, people, target)
        box = people.boxes[target]
        mask = self._propagation.mask_of(box)
        masks = self._cut_out(frame, people, target, known=mask is not None)
        if mask is not None:
            masks[target] = resized(mask, masks.shape[1:])
        self._propagation.keep(frame.rgb, box, masks[target])
        return masks

    def _cut_out(self, frame: Frame, people: Instances, target: int | None, *, known: bool = False) -> Masks:
        """Return everybody's mask; the target's may be wrong where it is known from elsewhere."""
        if people.masks is not None:
            return people.masks
        height, width = frame.rgb.shape[:2]
        masks = ellipses(people.boxes, width, height)
        if self._mask_head is not None and len(people):
            large = heights(people.boxes) >= WORTH_CUTTING_OUT * height
            nearest = [place for place in np.argsort(-people.boxes[:, 3], kind="stable") if large[place]]
            if target is not None:
                nearest = [target, *(place for place in nearest if place != target)]
            places = np.array(nearest[:CUT_OUT], np.intp)
            places = places[places != target] if known else places
            if len(places):
                masks[places] = self._mask_head(frame.rgb, people.boxes[places], MASK_SIZE)
        return masks


def _obstacle_masks(obstacles: Instances, width: int, height: int) -> Masks:
    """Return obstacles' own masks, or their boxes where there are none."""
    if obstacles.masks is not None:
        return obstacles.masks
    masks = np.zeros((len(obstacles), MASK_SIZE, MASK_SIZE), bool)
    scale = np.array([MASK_SIZE / width, MASK_SIZE / height] * 2)
    for mask, (left, top, right, bottom) in zip(
        masks, np.rint(obstacles.boxes * scale).astype(int), strict=True
    ):
        mask[top:bottom, left:right] = True
    return masks


def _fractions(box: NDArray[np.float32], frame: Frame) -> Box:
    height, width = frame.rgb.shape[:2]
    left, top, right, bottom = map(float, box)
    return Box(
        (left + right) / 2 / width,
        (top + bottom) / 2 / height,
        (right - left) / width,
        (bottom - top) / height,
    )
