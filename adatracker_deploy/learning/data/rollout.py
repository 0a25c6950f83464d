"""Rolls out one episode for a shard: steps the world, labels with the expert, records everything."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.learning.data.shard import EpisodeHeader, Steps, pack_masks
from adatracker_deploy.learning.data.state import StateColumns
from adatracker_deploy.learning.expert import DEFAULT_GAINS, Expert, ExpertGains
from adatracker_deploy.learning.tracking import ACTION, Tracking
from adatracker_deploy.policy.base import to_twist
from adatracker_deploy.policy.drawing import squared

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from adatracker_deploy.core.messages import ClassMask
    from adatracker_deploy.learning.episode_spec import EpisodeSpec


class Rollout:
    """An episode driven by any policy and labelled with the expert's actions.

    Attributes:
        mask: what is seen now, (64, 64), uint8.
        expert: the expert's action for now, (2,), float32.
        ended: the episode is over.
    """

    def __init__(self, spec: EpisodeSpec, steps: int, gains: ExpertGains = DEFAULT_GAINS) -> None:
        """Begin an episode of at most `steps` steps, with an expert of these gains.

        Raises:
            UsageError: its world or body is not installed.
        """
        self._spec = spec
        self._tracking = Tracking(spec, spec.task_settings(steps))
        self.mask: ClassMask = squared(self._tracking.begin().mask)
        self._guide = Expert(self._tracking, gains)
        self._columns = StateColumns(self._tracking)
        self._states = [self._columns.row()]
        """One more than steps: the last is where the episode ends."""
        self.expert: NDArray[np.float32] = self._guide.act(self.mask)
        self.ended = False
        self._dropped = False
        self._masks: list[ClassMask] = []
        self._rows: list[tuple[NDArray[np.float32], NDArray[np.float32], float, bool, bool, bool]] = []

    def __len__(self) -> int:
        """Return how many steps were made."""
        return len(self._rows)

    def step(self, action: NDArray[np.float32]) -> None:
        """Execute an action of shape (2,), clipped to [-1, 1]."""
        action = np.clip(action, -1.0, 1.0).astype(np.float32)
        command = to_twist(action, ACTION, self._tracking.limits)
        tick = self._tracking.follow(command)
        self._masks.append(self.mask)
        self._columns.stepped(action, tick.visible)
        self._states.append(self._columns.row())
        lost = tick.end == "lost"
        self._rows.append((action, self.expert, tick.reward, tick.visible, self._dropped, lost))
        self.mask, self._dropped, self.ended = squared(tick.observation.mask), tick.dropped, bool(tick.end)
        self._guide.executed(command)
        self.expert = self._guide.act(self.mask)

    def record(self) -> tuple[EpisodeHeader, Steps]:
        """Return what happened so far, at least one step."""
        actions, experts, rewards, visible, dropped, done = zip(*self._rows, strict=True)
        steps = Steps(
            masks=pack_masks(np.stack(self._masks)),
            actions=np.stack(actions),
            experts=np.stack(experts),
            rewards=np.array(rewards, np.float32),
            visible=np.array(visible),
            dropped=np.array(dropped),
            done=np.array(done),
            states=np.stack(self._states[:-1]),
            finals=self._states[-1][None],
        )
        return EpisodeHeader(spec=self._spec, steps=len(steps)), steps
