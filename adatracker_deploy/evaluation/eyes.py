"""Episodes that are seen by a segmenter of pictures instead of by the truth.

What the eyes see is judged by the truth of the same picture, pixel by pixel.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import Box, Click
from adatracker_deploy.core.sight import Verdict, judged
from adatracker_deploy.core.task import FIRST_SIGHT_S
from adatracker_deploy.perception.jpeg import developed
from adatracker_deploy.perception.segmenters import OF_REHEARSALS, open_segmenter
from adatracker_deploy.perception.target.choice import BY_CLICK, Choice
from adatracker_deploy.sim.studio import Eye

if TYPE_CHECKING:
    from adatracker_deploy.config.effects import RoadClass
    from adatracker_deploy.core.messages import Observation
    from adatracker_deploy.core.sight import Sight
    from adatracker_deploy.perception.segmenter import Segmenter
    from adatracker_deploy.sim.task import Task

_WIDTH_PX = 640
"""Of the pictures, which are as much higher or lower as the task's masks are."""


@dataclass(frozen=True, slots=True)
class Sights:
    """An episode's verdicts, as shares of its pictures."""

    seen: float
    """The target's, of the pictures that show it."""
    wrong: float
    """Somebody else's, of all pictures."""
    mask_iou: float
    """Mean, of the pictures in which the right person is seen."""


def check_eyes(segmenter: str) -> None:
    """Check, before anything is played, that pictures can be looked at.

    Raises:
        UsageError: the segmenter needs no pictures.
    """
    if segmenter in OF_REHEARSALS:
        raise UsageError(
            f"segmenter {segmenter!r}: looks at no pictures; expected embedded, or a model's file"
        )
    eyes_of(segmenter)


@functools.cache
def eyes_of(segmenter: str) -> Segmenter:
    """Return a segmenter, opened once a process; its target is whom the operator clicks on.

    Raises:
        UsageError: no such name.
    """
    return open_segmenter(segmenter, "person", Choice(rule=BY_CLICK))[0]


class Eyes:
    """Looks at a task's world from its body.

    Args:
        task: begun here.
        segmenter: sees; reset here.
        road: shakes the camera.
    """

    def __init__(self, task: Task, segmenter: Segmenter, road: RoadClass = "smooth") -> None:
        self._task, self._segmenter = task, segmenter
        rows, columns = task.settings.mask_size
        size = (_WIDTH_PX, round(_WIDTH_PX * rows / columns))
        self._eye = Eye(task.world, task.settings.fov_rad, size, seed=0, road=road)
        self._seq = 0
        self._sights: list[Sight] = []
        segmenter.reset()

    def first_sight(self) -> Observation | None:
        """Look until the target is seen, standing still, the operator clicking on it; None if it is not."""
        for _ in range(round(FIRST_SIGHT_S * self._task.settings.rate_hz)):
            seen = self.look(clicking=True)
            if seen.box is not None:
                return seen
        return None

    def look(self, *, clicking: bool = False) -> Observation:
        """Return what the eyes see now, the operator `clicking` on the middle of the target or not."""
        self._seq += 1
        t_ns = round(self._seq * 1e9 / self._task.settings.rate_hz)
        body = self._task.body
        shot = self._eye.take(t_ns, self._seq, body.pose, body.camera_pose)
        frame, box = developed(shot), Box.of_mask(shot.truth.mask)
        if clicking and box is not None:
            frame = replace(frame, click=Click(self._seq, self._seq, box.cx, box.cy))
        seen = self._segmenter(frame)
        self._sights.append(judged(seen.mask, shot.truth))
        return seen

    def summary(self) -> Sights:
        """Return the verdicts so far."""
        shown = [sight for sight in self._sights if sight.true_box is not None]
        right = [sight.mask_iou for sight in shown if sight.verdict is Verdict.SEEN]
        wrong = sum(sight.verdict is Verdict.SOMEBODY_ELSE for sight in self._sights)
        return Sights(
            seen=len(right) / max(1, len(shown)),
            wrong=wrong / max(1, len(self._sights)),
            mask_iou=float(np.mean(right)) if right else 0.0,
        )
