"""Logged trials as training data: the masks that the policy saw, what the robot was sent, the box's reward.

A log knows no expert and no true state. Experts are NaN, and no method that asks for them takes logs. States
are what the robot and its eyes measured (`COLUMNS`). Of the body only the limits are known: the height of the
camera, its lens, lag and delay are NaN, and losses leave them out.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.task import MAX_LOST_STEPS
from adatracker_deploy.learning.data.shard import Steps, pack_masks
from adatracker_deploy.learning.data.state import ACTION_COLUMNS, REMEMBERED, described
from adatracker_deploy.learning.embodiment import Embodiment
from adatracker_deploy.learning.episode_spec import MASK_SIZE, RATE_HZ
from adatracker_deploy.policy.drawing import squared
from adatracker_deploy.trial.ending import ending
from adatracker_deploy.trial.episodes import episodes, first_box, seen_box, tick_rate_hz
from adatracker_deploy.trial.folder import FILE_NAME, PART_NAME
from adatracker_deploy.trial.limits import limits_of
from adatracker_deploy.trial.reader import read_trial
from adatracker_deploy.trial.search import search

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from adatracker_deploy.config.limits import Limits
    from adatracker_deploy.core.messages import Box, ClassMask, Twist
    from adatracker_deploy.core.record import StepRecord
    from adatracker_deploy.trial.episodes import Episode

COLUMNS = (
    *("off_x", "off_y", "off_w", "off_h"),  # the box less the trial's first, fractions; held while unseen
    *("moved_x", "moved_y", "moved_w", "moved_h"),  # by how much that changed since the tick before
    *("forward_m_s", "yaw_rate_rad_s"),  # measured; what was sent last, of a robot that tells no velocity
    *("log_forward", "log_backward", "log_yaw"),
    *("lost", "visible"),  # consecutive ticks without a box as a share of those that end a trial
    *ACTION_COLUMNS,
)
"""Columns of a logged step in place of `state.COLUMNS`, for critics."""
_RATE_TOLERANCE = 0.05
_SIDEWAYS_M_S = 1e-3
_LEAST_LIMIT = 1e-3
"""m/s and rad/s: a robot that is let less cannot be driven."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggedHeader:
    """Description of one logged episode."""

    body: Embodiment
    """With NaN where the log does not know it."""
    steps: int

    @property
    def change(self) -> None:
        """None: a log knows of no change of the body."""


def logged_trials(folder: Path) -> list[Path]:
    """Return the files of all trials in a folder and in what it holds, sorted."""
    return sorted(search(folder, {FILE_NAME, PART_NAME}.__contains__).files)


def read_logged(path: Path) -> list[tuple[LoggedHeader, Steps]]:
    """Read a trial as episodes (`trial.episodes`).

    Raises:
        UsageError: it is not a trial, does not say its robot's limits, was run at another rate than the
            networks', or drove sideways, which their actions cannot say.
    """
    trial = read_trial(path)
    ended = ending(trial)
    steps = trial.steps[: ended.ticks]
    rate_hz = tick_rate_hz(steps)
    if rate_hz is None:
        return []
    if abs(rate_hz - RATE_HZ) > _RATE_TOLERANCE * RATE_HZ:
        raise UsageError(f"{path}: its rate is {rate_hz:.1f} Hz; the networks learn at {RATE_HZ:g} Hz")
    limits, first = limits_of(trial), first_box(steps)
    if min(limits.forward_m_s, limits.yaw_rate_rad_s) < _LEAST_LIMIT:
        raise UsageError(f"{path}: its robot may not drive forward and turn: there is no action to learn")
    masks = {mask.seq: pack_masks(reduced(mask.mask)) for mask in trial.masks()}
    found = episodes(steps, ended.outcome, masks)
    if any(abs(one.sent.vy) > _SIDEWAYS_M_S for episode in found for one in episode):
        raise UsageError(f"{path}: its robot drove sideways; actions here are forward and yaw")
    return [
        (LoggedHeader(body=_body(limits), steps=len(episode)), _steps(episode, masks, limits, first))
        for episode in found
    ]


def reduced(mask: ClassMask) -> ClassMask:
    """Return a mask (H, W) as the policy saw it, (64, 64): in a square, its nearest pixels."""
    size = (MASK_SIZE, MASK_SIZE)
    return np.asarray(cv2.resize(squared(mask), size, interpolation=cv2.INTER_NEAREST), np.uint8)


def action_of(sent: Twist, limits: Limits) -> tuple[float, float]:
    """Return what a policy had to answer for a velocity to be sent: `to_twist` turned round."""
    forward, yaw = sent.vx / limits.forward_m_s, sent.yaw_rate / limits.yaw_rate_rad_s
    return min(max(forward, -1.0), 1.0), min(max(yaw, -1.0), 1.0)


def _body(limits: Limits) -> Embodiment:
    return Embodiment(
        height_m=math.nan,
        pitch_deg=math.nan,
        fov_deg=math.nan,
        forward_m_s=limits.forward_m_s,
        backward_m_s=limits.backward_m_s,
        yaw_rate_rad_s=limits.yaw_rate_rad_s,
        lag_s=math.nan,
        delay_s=math.nan,
    )


def _steps(
    episode: Episode, masks: Mapping[int, NDArray[np.uint8]], limits: Limits, first: Box | None
) -> Steps:
    count = len(episode)
    states = _states(episode, limits, first)
    return Steps(
        masks=np.stack([masks[one.tick.frame_seq] for one in episode]),
        actions=np.array([action_of(one.sent, limits) for one in episode], np.float32),
        experts=np.full((count, 2), np.nan, np.float32),
        rewards=np.array([one.reward for one in episode], np.float32),
        visible=np.array([one.seen for one in episode]),
        dropped=np.zeros(count, np.bool_),
        done=np.array([one.done for one in episode]),
        states=states[:-1],
        finals=states[-1:],
    )


def _states(episode: Episode, limits: Limits, first: Box | None) -> NDArray[np.float32]:
    """Return `COLUMNS` of each tick of an episode and of the one after it."""
    log_limits = described(_body(limits))[3:6]
    seen = _Seen(first)
    remembered: deque[tuple[float, float]] = deque([(0.0, 0.0)] * REMEMBERED, maxlen=REMEMBERED)
    rows = []
    before: Twist | None = None
    for tick, sent in [*((one.tick, one.sent) for one in episode), (episode[-1].after, None)]:
        own = tick.velocity or before
        rows.append(
            (
                *(values := seen.row(tick))[:-2],
                *((own.vx, own.yaw_rate) if own is not None else (0.0, 0.0)),
                *log_limits,
                *values[-2:],
                *(value for action in remembered for value in action),
            )
        )
        if sent is not None:
            remembered.appendleft(action_of(sent, limits))
        before = sent
    return np.array(rows, np.float32)


class _Seen:
    """Follows the target's box through an episode."""

    def __init__(self, first: Box | None) -> None:
        self._first = first
        self._off: tuple[float, ...] | None = None
        """Its place when it was last seen; None before that."""
        self._lost = 0

    def row(self, tick: StepRecord) -> tuple[float, ...]:
        """Return ``off``, ``moved``, ``lost`` and ``visible``, as `COLUMNS` names them."""
        box, last = seen_box(tick), self._off
        moved: Sequence[float] = (0.0,) * 4
        if box is not None and self._first is not None:
            at = self._first
            self._off = (box.cx - at.cx, box.cy - at.cy, box.w - at.w, box.h - at.h)
            if last is not None and not self._lost:
                moved = [now - was for now, was in zip(self._off, last, strict=True)]
        self._lost = 0 if box is not None else self._lost + 1
        return (*(self._off or (0.0,) * 4), *moved, self._lost / MAX_LOST_STEPS, float(box is not None))
