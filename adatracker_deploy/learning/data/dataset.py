"""Samples sequences of steps with their past from shards held in memory."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.data.search import search_labels
from adatracker_deploy.learning.data.shard import Steps, read_shard, unpack_masks
from adatracker_deploy.learning.data.state import described
from adatracker_deploy.learning.episode_spec import EpisodeSpec

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from adatracker_deploy.learning.data.shard import EpisodeHeader

START_SHARE = 0.25
"""This share of the sequences starts at an episode's start, as every run on a robot does."""

_Index = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Batch:
    """B sequences of L steps, each behind K steps of its past.

    In `masks` and `actions` the first K entries are the past: for the step at place K + t, the pairs of its
    history are those at t to K + t - 1. Before an episode's start they are zeros, as at deployment. Places
    beyond an episode's end are zeros and not `valid`.
    """

    masks: NDArray[np.uint8]
    """(B, K + L, 64, 64), classes."""
    actions: NDArray[np.float32]
    """(B, K + L, 2), executed."""
    experts: NDArray[np.float32]
    """(B, L, 2), the expert's clean actions."""
    rewards: NDArray[np.float32]
    """(B, L)."""
    visible: NDArray[np.bool_]
    """(B, L)."""
    done: NDArray[np.bool_]
    """(B, L): the step ended the episode as lost."""
    valid: NDArray[np.bool_]
    """(B, L)."""
    start: NDArray[np.bool_]
    """(B,): the sequence begins at its episode's start."""
    height_m: NDArray[np.float32]
    """(B,)."""
    log_limits: NDArray[np.float32]
    """(B, 3): natural logarithm of the limits forward and backward, m/s, and of the yaw rate, rad/s."""
    lag_s: NDArray[np.float32]
    """(B,)."""
    delay_s: NDArray[np.float32]
    """(B,)."""
    states: NDArray[np.float32]
    """(B, L, S), true."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Moves:
    """N single steps by their true states, for critics."""

    states: NDArray[np.float32]
    """(N, S), before the step."""
    actions: NDArray[np.float32]
    """(N, 2), executed."""
    rewards: NDArray[np.float32]
    """(N,)."""
    nexts: NDArray[np.float32]
    """(N, S), after the step."""
    done: NDArray[np.bool_]
    """(N,): the step ended the episode as lost."""


class Dataset:
    """All episodes of some folders of shards.

    Attributes:
        specs: of each episode, in the order of the shards.
        steps: all steps, their masks packed.
    """

    def __init__(self, episodes: Iterable[EpisodeHeader], steps: Steps) -> None:
        """Take episodes and their steps, one after the other."""
        episodes = list(episodes)
        headers = [episode for episode in episodes if episode.steps]
        self.specs: tuple[EpisodeSpec, ...] = tuple(episode.spec for episode in headers)
        kept = np.array([episode.steps > 0 for episode in episodes], bool)
        self.steps = steps if kept.all() else replace(steps, finals=steps.finals[kept])
        self._length: _Index = np.array([episode.steps for episode in headers], np.int64)
        self._first: _Index = np.cumsum(self._length) - self._length
        self._bodies = np.array([described(spec.embodiment) for spec in self.specs], np.float32)

    @classmethod
    def open(cls, folders: Iterable[Path]) -> Self:
        """Load every shard in the folders and in what they hold, such as what a run visited.

        Raises:
            UsageError: there are no shards, or one is damaged or of another schema.
        """
        folders = list(folders)
        paths = [path for folder in folders for path in sorted(folder.rglob("shard-*.npz"))]
        if not paths:
            raise UsageError(f"no shards in {', '.join(map(str, folders))}: collect some first")
        shards = [read_shard(path) for path in paths]
        episodes = [episode for shard in shards for episode in shard.episodes]
        return cls(episodes, Steps.joined([shard.steps for shard in shards]))

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.steps)

    def searching(self) -> Self:
        """Return the same data, the expert's actions replaced by search labels where the target is gone."""
        first = np.repeat(self._first, self._length)
        labels = search_labels(self.steps.masks, self.steps.experts, first)
        found = copy.copy(self)
        found.steps = replace(self.steps, experts=labels)
        return found

    def sample(self, rng: np.random.Generator, batch: int, length: int, history: int) -> Batch:
        """Draw sequences: an episode as likely as it is long, and in it a place to begin.

        Args:
            rng: decides.
            batch: B.
            length: L.
            history: K.
        """
        episode = rng.choice(len(self._length), size=batch, p=self._length / self._length.sum())
        longest = np.maximum(self._length[episode] - length, 0)
        begin = np.where(rng.random(batch) < START_SHARE, 0, rng.integers(0, longest + 1))
        return self.take(episode, begin, length, history)

    def moves(self, rng: np.random.Generator, count: int) -> Moves:
        """Draw `count` single steps, each as likely."""
        index = rng.integers(0, len(self), count)
        episode = np.searchsorted(self._first, index, side="right") - 1
        last = index == self._first[episode] + self._length[episode] - 1
        steps = self.steps
        after = steps.states[np.where(last, index, index + 1)]
        return Moves(
            states=steps.states[index],
            actions=steps.actions[index],
            rewards=steps.rewards[index],
            nexts=np.where(last[:, None], steps.finals[episode], after),
            done=steps.done[index],
        )

    def take(self, episode: _Index, begin: _Index, length: int, history: int) -> Batch:
        """Return the sequences that begin at steps `begin` (B,) of episodes `episode` (B,)."""
        place = begin[:, None] + np.arange(-history, length)
        exists = (place >= 0) & (place < self._length[episode][:, None])
        index = np.where(exists, self._first[episode][:, None] + place, 0)
        now, valid = index[:, history:], exists[:, history:]
        body = self._bodies[episode]
        steps = self.steps
        return Batch(
            masks=unpack_masks(np.where(exists[..., None], steps.masks[index], np.uint8(0))),
            actions=np.where(exists[..., None], steps.actions[index], np.float32(0)),
            experts=np.where(valid[..., None], steps.experts[now], np.float32(0)),
            rewards=np.where(valid, steps.rewards[now], np.float32(0)),
            visible=steps.visible[now] & valid,
            done=steps.done[now] & valid,
            valid=valid,
            start=begin == 0,
            height_m=body[:, 0],
            log_limits=body[:, 3:6],
            lag_s=body[:, 6],
            delay_s=body[:, 7],
            states=np.where(valid[..., None], steps.states[now], np.float32(0)),
        )
