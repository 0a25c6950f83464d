"""The segmenter for real images: a detector, the target lock and a mask head.

Pure but for its state: the same frames, in the same order, always give the same observations.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np

from adatracker_deploy.core.messages import Box, MaskClass, Observation, Pick, TargetState, at_size
from adatracker_deploy.perception.boxes import heights, within
from adatracker_deploy.perception.drawing import MASK_SIZE, class_mask, ellipses, mask_shape
from adatracker_deploy.perception.roles import Instances
from adatracker_deploy.perception.target.appearance import appearances
from adatracker_deploy.perception.target.choice import Choice
from adatracker_deploy.perception.target.first_sight import FirstSight
from adatracker_deploy.perception.target.lock import Locked, TargetLock
from adatracker_deploy.perception.target.motion import CameraMotion
from adatracker_deploy.perception.target.picks import RecentPeople, Sighting
from adatracker_deploy.perception.target.propagation import Propagation, resized

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from adatracker_deploy.core.messages import Click, Frame
    from adatracker_deploy.perception.roles import Detector, MaskHead, Masks, Propagator, Witness

PERSON = "person"
LEAST_OBSTACLE_SCORE = 0.5
SEARCHED = (0.38, None)
"""Heights that the detector is given in turn while nobody is followed, shares of the picture's longer side:
people whom it is weak at in the one picture it finds in the next."""
CUT_OUT = 2
"""Number of people with masks from the mask head: the target and the nearest others; each costs
milliseconds."""
WITHIN = 0.8
"""Share of a person's box within the target's above which they never cover it: somebody nearer would be
larger, so it is somebody behind, or the target again."""
WORTH_CUTTING_OUT = 0.25
"""Share of the image height below which other people are drawn as ellipses; few px are wrong then."""
LEAST_CUT_OUT = 0.25
"""Share of the ellipse in a person's box below which what was cut out is not the person. The mask head misses
those of whom the picture shows little more than the head, and a target whom it missed would be in no mask."""


class TargetSegmenter:
    """Implements `Segmenter`.

    Args:
        detector: of people and, by any other word, of obstacles.
        mask_head: cuts people out; needed where the detector gives boxes alone.
        choice: who becomes the target; it takes several pictures.
        least_score: of people who are tracked; the others are looked at while the target is chosen, and where
            it is missed.
        propagator: follows the target's mask, also where the detector misses the target.
        key_frames: do not ask the detector while the propagator sees the target and the lock agreed in the
            picture before: for slow detectors. Nobody else and no obstacle is known in between.
        witness: asked about people of whom the detector is not sure, while the target is chosen.
    """

    needs_truth = False

    def __init__(
        self,
        detector: Detector,
        mask_head: MaskHead | None,
        choice: Choice | None = None,
        propagator: Propagator | None = None,
        *,
        least_score: float = 0.0,
        key_frames: bool = False,
        witness: Witness | None = None,
    ) -> None:
        self._detector = detector
        self._mask_head = mask_head
        self._choice = choice or Choice()
        self._propagation = Propagation(propagator) if propagator else None
        self._least_score = least_score
        self._key_frames = key_frames
        self._witness = witness
        self.reset()

    def reset(self) -> None:
        """Forget the target: the next frame with such a person chooses anew."""
        self._lock = TargetLock()
        self._outline: Outline | None = None
        self._tall: float | None = None
        self._looks = 0
        self._motion = CameraMotion()
        self._first_sight: FirstSight | None = FirstSight(self._choice)
        self._recent = RecentPeople()
        self._pick: Pick | None = None
        self._awaited = False
        if self._propagation:
            self._propagation.reset()

    def __call__(self, frame: Frame) -> Observation:
        """Return what is in the frame; one after the other, in the order they were taken.

        Raises:
            PlatformError: the model gave what no such model gives.
        """
        followed = self._propagation.step(frame.rgb) if self._propagation else None
        between = self._key_frames and followed is not None and followed.trusted and frame.click is None
        found = Instances.none() if between else self._detector(frame.rgb, self._looked_for())
        kinds = np.array([word == PERSON for word in found.words], bool)
        sure = found.scores >= (0.0 if self._first_sight else self._least_score)
        people, faint = found.only(np.flatnonzero(kinds & sure)), found.only(np.flatnonzero(kinds & ~sure))
        obstacles = found.only(np.flatnonzero(~kinds & (found.scores >= LEAST_OBSTACLE_SCORE)))
        if followed:
            people = followed.among(people, PERSON)
        everybody, sure_ones = people + faint, range(len(people))
        locked = self._locked(frame, everybody, len(people))
        place = locked.place if locked else None
        if place is not None and place not in sure_ones:
            people, place = everybody.only([*sure_ones, place]), len(people)
        if place is not None:
            self._tall = float(heights(people.boxes)[place]) / max(frame.rgb.shape[:2])
        elif locked is None or locked.state is not TargetState.COASTING:
            self._tall = None
        mask = self._drawn(frame, people, obstacles, place)
        box = None if place is None else people.boxes[place]
        if box is not None:
            self._outline = Outline(mask == MaskClass.TARGET, box)
        elif locked is not None and locked.expected is not None and self._outline is not None:
            box = inside(np.array(locked.expected, np.float32), frame)
            mask = mask if box is None else self._outline.drawn(mask, box, frame)
        return Observation(
            mask=mask,
            box=None if box is None else _fractions(box, frame),
            confidence=locked.likeness if locked else 0.0,
            t_ns=frame.t_ns,
            seq=frame.seq,
            target=locked.state if locked else None,
            pick=self._pick,
        )

    def _looked_for(self) -> float | None:
        """Return how tall the target was last; of one who is lost, by turns, what covers all sizes."""
        if self._tall is not None:
            return self._tall
        self._looks += 1
        return SEARCHED[self._looks % len(SEARCHED)]

    def _locked(self, frame: Frame, everybody: Instances, sure: int) -> Locked | None:
        """Return what the lock says; None while nobody has been chosen.

        Its place is among everybody, of whom the first `sure` ones are surely people.
        """
        height, width = frame.rgb.shape[:2]
        people = everybody.only(range(sure))
        every_look = appearances(frame.rgb, everybody.boxes)
        looks = every_look[:sure]
        motion = self._motion(frame.rgb, people.boxes)
        self._recent.add(Sighting(frame.seq, frame.t_ns, people.boxes, people.scores, looks, motion))
        locked = None
        if self._first_sight is None:
            locked = self._lock.update(
                everybody.boxes, everybody.scores, every_look, motion, frame.t_ns, sure=sure
            )
        if frame.click is not None:
            locked = self._picked(frame.click, frame, locked)
        if self._first_sight is None:
            return None if locked is None else self._seen_since(locked)
        witness = self._witness
        vote = (lambda at: witness.person_in(frame.rgb, people.boxes[at])) if witness else None
        place = self._first_sight(people, width, height, frame.t_ns, vote)
        if place is None:
            return None
        self._first_sight = None
        return self._lock.choose(place, people.boxes, looks, frame.t_ns)

    def _picked(self, click: Click, frame: Frame, before: Locked | None) -> Locked | None:
        """Make whom the operator has clicked on the target; return what its lock says of the frame.

        That of the target `before`, where nobody was there, or they are the target already.
        """
        height, width = frame.rgb.shape[:2]
        found = self._recent.locked_on(click, width, height)
        taken = self._pick.taken if self._pick else 0
        if found is None:
            self._pick = Pick(click, None, taken)
            return before
        box, place = _fractions(found.box, frame), found.locked.place
        if before is not None and before.place is not None and before.place == place:
            self._pick = Pick(click, box, taken)
            return before
        self._pick = Pick(click, box, taken + 1)
        self._lock, self._first_sight, self._outline, self._awaited = found.lock, None, None, True
        if self._propagation:
            self._propagation.reset()
        return found.locked

    def _seen_since(self, locked: Locked) -> Locked:
        """Return what the lock says; of a new target that has not been seen since the choice, only that."""
        if self._awaited and locked.place is None:
            return Locked(TargetState.CHOOSING, None, 0.0)
        self._awaited = False
        return locked

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
        bottoms = people.boxes[:, 3].copy()
        if target is not None:
            behind = within(people.boxes, people.boxes[target]) > WITHIN
            behind[target] = False
            bottoms[behind] = np.minimum(bottoms[behind], bottoms[target] - 1.0)
        drawn = class_mask(masks, values, np.concatenate((bottoms, obstacle_bottoms)))
        return at_size(drawn, *mask_shape(height, width))

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
                cut = self._mask_head(frame.rgb, people.boxes[places], MASK_SIZE)
                found = cut.sum(axis=(1, 2)) >= LEAST_CUT_OUT * masks[places].sum(axis=(1, 2))
                masks[places[found]] = cut[found]
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


class Outline(NamedTuple):
    """The target as it was seen last, to be drawn where it is expected."""

    mask: NDArray[np.bool_]
    """Shape (S, S), over the whole picture."""
    box: NDArray[np.float32]
    """px."""

    def drawn(self, mask: NDArray[np.uint8], box: NDArray[np.float32], frame: Frame) -> NDArray[np.uint8]:
        """Return a class mask (S, S) with the target in `box`, px, behind everybody who was found."""
        height, width = frame.rgb.shape[:2]
        cells = np.array([self.mask.shape[1] / width, self.mask.shape[0] / height] * 2)
        (left, top, right, bottom), (to_left, to_top, to_right, to_bottom) = self.box * cells, box * cells
        across, down = (to_right - to_left) / (right - left), (to_bottom - to_top) / (bottom - top)
        moved = cv2.warpAffine(
            self.mask.astype(np.uint8),
            np.array([[across, 0, to_left - across * left], [0, down, to_top - down * top]]),
            self.mask.shape[::-1],
            flags=cv2.INTER_NEAREST,
        )
        return np.where((moved > 0) & (mask != MaskClass.PERSON), np.uint8(MaskClass.TARGET), mask)


def inside(box: NDArray[np.float32], frame: Frame) -> NDArray[np.float32] | None:
    """Return the part of a box, px, that is in the picture; None where less than half is."""
    height, width = frame.rgb.shape[:2]
    cut = np.clip(box, 0, (width, height, width, height)).astype(np.float32)
    size, whole = np.prod(cut[2:] - cut[:2]), np.prod(box[2:] - box[:2])
    return cut if size > 0.5 * whole else None
