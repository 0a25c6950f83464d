"""Samples sequences of steps with their past from shards, or from logged trials, held in memory."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.data.logged import logged_trials, read_logged
from adatracker_deploy.learning.data.search_labels import search_labels
from adatracker_deploy.learning.data.shard import Steps, read_shard
from adatracker_deploy.learning.data.state import described
from adatracker_deploy.learning.data.told import told_at_steps
from adatracker_deploy.policy.past import Told

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from adatracker_deploy.learning.data.logged import LoggedHeader
    from adatracker_deploy.learning.data.shard import EpisodeHeader

START_SHARE = 0.25
"""This share of the sequences starts at an episode's start, as every run on a robot does."""

_Index = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Batch:
    """B sequences of L steps, each behind K steps of its past.

    In `packed` and `actions` the first K entries are the past: for the step at place K + t, the pairs of its
    history are those at t to K + t - 1. Before an episode's start they are zeros, as at deployment. Places
    beyond an episode's end are zeros and not `valid`.
    """

    packed: NDArray[np.uint8]
    """(B, K + L, P), the masks as a shard has them."""
    statistics: NDArray[np.float32]
    """(B, K + L, F), `mask_statistics`; no columns unless the data have them."""
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
    """(B, L, 3): natural logarithm of the limits forward and backward, m/s, and of the yaw rate, rad/s."""
    lag_s: NDArray[np.float32]
    """(B, L)."""
    delay_s: NDArray[np.float32]
    """(B, L)."""
    states: NDArray[np.float32]
    """(B, L, S), true."""
    beliefs: NDArray[np.float32]
    """(B, L, `belief.SIZE`); no columns unless the data are `told` it."""
    responses: NDArray[np.float32]
    """(B, L, `response.SIZE`); likewise."""
    inputs: NDArray[np.float32]
    """(B, L, U), what a policy's memory reads; no columns unless the data have them, and then no masks."""


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
    """All episodes of some folders.

    Attributes:
        headers: of each episode, in the order of the shards, or of the trials.
        steps: all steps, their masks packed.
        logged: they are of logged trials: `steps.experts` are NaN, `steps.states` are what was measured
            (`logged.COLUMNS`), and rewards are the box's.
    """

    def __init__(
        self, episodes: Iterable[EpisodeHeader | LoggedHeader], steps: Steps, *, logged: bool = False
    ) -> None:
        """Take episodes and their steps, one after the other."""
        episodes = list(episodes)
        headers = [episode for episode in episodes if episode.steps]
        self.headers: tuple[EpisodeHeader | LoggedHeader, ...] = tuple(headers)
        self.logged = logged
        kept = np.array([episode.steps > 0 for episode in episodes], bool)
        self.steps = steps if kept.all() else replace(steps, finals=steps.finals[kept])
        self._length: _Index = np.array([episode.steps for episode in headers], np.int64)
        self._first: _Index = np.cumsum(self._length) - self._length
        nothing = np.zeros((len(steps), 0), np.float32)
        self._told = Told(nothing, nothing)
        self._statistics = np.zeros((len(steps), 0), np.float16)
        self._inputs = np.zeros((len(steps), 0), np.float16)
        bodies = [(header.body, header.change) for header in headers]
        self._bodies = np.array(
            [[described(body), described(change.of(body) if change else body)] for body, change in bodies],
            np.float32,
        )
        """(E, 2, columns of a body), before and after its change."""
        self._changes: _Index = np.array(
            [
                change.at_step if change else steps
                for (_, change), steps in zip(bodies, self._length, strict=True)
            ]
        )

    @classmethod
    def open(cls, folders: Iterable[Path]) -> Self:
        """Load every shard, or every trial, in the folders and in what they hold.

        Raises:
            UsageError: there are neither, or both; a shard is damaged or of another schema; `read_logged`.
        """
        folders = list(folders)
        paths = [path for folder in folders for path in sorted(folder.rglob("shard-*.npz"))]
        trials = [trial for folder in folders for trial in logged_trials(folder)]
        if paths and trials:
            raise UsageError(
                f"{paths[0].parent} holds shards and {trials[0].parent} a trial: their rewards differ; "
                "learn from one, then from the other by --init"
            )
        if trials:
            records = [record for trial in trials for record in read_logged(trial)]
            if not records:
                raise UsageError(f"{len(trials)} trials, but none has two ticks in a row with their masks")
            headers, parts = zip(*records, strict=True)
            return cls(headers, Steps.joined(parts), logged=True)
        if not paths:
            places = ", ".join(map(str, folders))
            raise UsageError(f"no shards and no trials in {places}: collect some first")
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

    def told(self, *, believes: bool, responds: bool) -> Self:
        """Return the same data, with what a policy is told of its past (`policy.past`) at each step."""
        found = copy.copy(self)
        steps = self.steps
        found._told = told_at_steps(
            steps.masks, steps.actions, self._first, self._length, believes=believes, responds=responds
        )
        return found

    def followed_by(self, other: Self) -> Self:
        """Return these episodes and then those of another data set, which was told and given as much."""
        both = type(self)(
            (*self.headers, *other.headers), Steps.joined([self.steps, other.steps]), logged=self.logged
        )
        both._told = Told(*(np.concatenate(pair) for pair in zip(self._told, other._told, strict=True)))
        both._statistics = np.concatenate((self._statistics, other._statistics))
        both._inputs = np.concatenate((self._inputs, other._inputs))
        return both

    def with_statistics(self, statistics: NDArray[np.float16]) -> Self:
        """Return the same data, with the `mask_statistics` (T, F) of each of its masks."""
        found = copy.copy(self)
        found._statistics = statistics
        return found

    def with_inputs(self, inputs: NDArray[np.float16]) -> Self:
        """Return the same data, with what a policy's memory reads at each of its steps, (T, U)."""
        found = copy.copy(self)
        found._inputs = inputs
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
        late = (place[:, history:] >= self._changes[episode][:, None]).astype(np.int64)
        body = self._bodies[episode[:, None], late]
        steps = self.steps
        masks, statistics = steps.masks, self._statistics
        if self._inputs.shape[1]:
            masks, statistics = masks[:, :0], statistics[:, :0]
        return Batch(
            packed=np.where(exists[..., None], masks[index], np.uint8(0)),
            statistics=np.where(exists[..., None], statistics[index], np.float32(0)),
            actions=np.where(exists[..., None], steps.actions[index], np.float32(0)),
            experts=np.where(valid[..., None], steps.experts[now], np.float32(0)),
            rewards=np.where(valid, steps.rewards[now], np.float32(0)),
            visible=steps.visible[now] & valid,
            done=steps.done[now] & valid,
            valid=valid,
            start=begin == 0,
            height_m=body[:, 0, 0],
            log_limits=body[..., 3:6],
            lag_s=body[..., 6],
            delay_s=body[..., 7],
            states=np.where(valid[..., None], steps.states[now], np.float32(0)),
            beliefs=np.where(valid[..., None], self._told.belief[now], np.float32(0)),
            responses=np.where(valid[..., None], self._told.response[now], np.float32(0)),
            inputs=np.where(valid[..., None], self._inputs[now], np.float32(0)),
        )
