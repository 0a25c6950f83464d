"""Runs policies on episodes in one or several processes, with one network session per policy and process."""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.camera import is_unreal
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.task import SIMULATOR_LEAST_REWARD
from adatracker_deploy.evaluation.eyes import Eyes, eyes_of
from adatracker_deploy.learning.tracking import Tracking
from adatracker_deploy.perception.segmenters import TRUTH
from adatracker_deploy.policy.base import to_twist
from adatracker_deploy.policy.catalogue import load_policy

if TYPE_CHECKING:
    from collections.abc import Generator, Sequence

    from adatracker_deploy.evaluation.eyes import Sights
    from adatracker_deploy.learning.episode_spec import EpisodeSpec
    from adatracker_deploy.policy.base import Policy

Contexts = NDArray[np.float32]


@dataclass(frozen=True, slots=True, kw_only=True)
class Episode:
    """One episode to be played; nothing but plain values, for other processes."""

    policy: str
    """As `load_policy` takes it."""
    spec: EpisodeSpec
    steps: int = 500
    """The horizon."""
    with_contexts: bool = False
    """Every tick's z is wanted."""
    segmenter: str = TRUTH
    """As `open_segmenter` takes it; all but the truth are shown pictures."""
    imposed: Contexts | None = None
    """A z of shape (Z,) to answer with instead of the encoder's own."""


@dataclass(frozen=True, slots=True)
class Played:
    """The result of an episode."""

    ar: float
    """Accumulated reward."""
    el: int
    """Steps until it ended."""
    success: bool
    """The horizon was reached."""
    contexts: Contexts | None = None
    """z a tick, (T, Z), where it was wanted."""
    sights: Sights | None = None
    """The eyes' scores, where they were given pictures."""
    below_floor: float = 0.0
    """What the rewards that were below the published simulator's floor lacked to it, in all; at least 0."""

    @property
    def floored_ar(self) -> float:
        """AR as the published simulator adds it up: no step counts less than its floor."""
        return self.ar + self.below_floor


def play(policy: Policy, episode: Episode) -> Played:
    """Play an episode with a policy that is loaded; the same spec gives every policy the same world.

    Raises:
        UsageError: the world or body is not installed, or the policy has no context where one is needed.
    """
    tracking = Tracking(episode.spec, episode.spec.task_settings(episode.steps))
    policy.reset(episode.spec.seed)
    if episode.imposed is not None:
        _impose(policy, episode)
    seen = tracking.begin()
    eyes = None
    if episode.segmenter != TRUTH:
        eyes = Eyes(tracking.task, eyes_of(episode.segmenter), episode.spec.effects.road)
    if eyes is not None:
        first = eyes.first_sight()
        if first is None:
            return Played(0.0, 0, success=False, sights=eyes.summary())
        seen = first
    rewards: list[float] = []
    contexts: list[Contexts] = []
    while True:
        action = policy.act(seen)
        if episode.with_contexts:
            if action.context is None:
                raise UsageError(f"policy {episode.policy!r} has no context encoder, so no context to study")
            contexts.append(action.context)
        tick = tracking.follow(to_twist(action.values, policy.info.action, tracking.limits))
        rewards.append(tick.reward)
        if tick.end:
            return Played(
                math.fsum(rewards),
                len(rewards),
                tick.end == "completed",
                contexts=np.array(contexts) if contexts else None,
                sights=eyes.summary() if eyes else None,
                below_floor=math.fsum(max(0.0, SIMULATOR_LEAST_REWARD - reward) for reward in rewards),
            )
        seen = eyes.look() if eyes else tick.observation


def play_all(episodes: Sequence[Episode], workers: int = 1) -> Generator[tuple[int, Played], None, None]:
    """Play episodes; yield each one's place in `episodes` and what came of it, as soon as it is over.

    Closed early, it waits for the episodes that are being played and begins no others.

    Args:
        episodes: begun in this order.
        workers: processes; 1 stays in this one, and so does everything that an engine simulates.

    Raises:
        UsageError: a policy is refused, or see `play`.
        PlatformError: a worker process died.
    """
    if any(is_unreal(episode.spec.scene) for episode in episodes):
        workers = 1  # an engine serves one client
    if workers == 1:
        players = _Players()
        yield from ((index, players(episode)) for index, episode in enumerate(episodes))
        return
    # Read when a worker loads its linear algebra: threads that wait for each other on busy cores cost more
    # than they bring.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    spawn = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(workers, len(episodes) or 1), spawn, _become_worker)
    try:
        places = {pool.submit(_work, episode): index for index, episode in enumerate(episodes)}
        for future in as_completed(places):
            yield places[future], future.result()
    except BrokenProcessPool as error:
        raise PlatformError("a worker process died, perhaps for memory; try fewer --workers") from error
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


class _Players:
    """Plays episodes with policies that are loaded once."""

    def __init__(self) -> None:
        self._policies: dict[str, Policy] = {}

    def __call__(self, episode: Episode) -> Played:
        if episode.policy not in self._policies:
            self._policies[episode.policy] = load_policy(episode.policy)
        return play(self._policies[episode.policy], episode)


_worker = _Players()
"""The players of a worker process, which lives for one `play_all` and so never sees a policy change on
disk."""


def _become_worker() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to handle
    cv2.setNumThreads(1)


def _work(episode: Episode) -> Played:
    return _worker(episode)


def _impose(policy: Policy, episode: Episode) -> None:
    from adatracker_deploy.policy.onnx_policy import OnnxPolicy

    assert isinstance(policy, OnnxPolicy)
    assert episode.imposed is not None
    policy.override_context(episode.imposed)
