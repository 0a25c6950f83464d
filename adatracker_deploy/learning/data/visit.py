"""Collects what a policy visits: many episodes in lock-step, driven by any policy, labelled by the expert.

Ross, Gordon and Bagnell, "A Reduction of Imitation Learning and Structured Prediction to No-Regret Online
Learning" (AISTATS 2011): the states are the policy's, the labels the expert's, mixed with stretches in which
the expert drives. Methods that learn from rewards have the policy perturbed instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.data.perturbation import Perturbation
from adatracker_deploy.learning.data.rollout import Rollout
from adatracker_deploy.learning.data.shard import SHARD_STEPS, Record, joined_shard, shard_name, write_shard
from adatracker_deploy.learning.seeds import training_seed

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from adatracker_deploy.learning.data.recipe import Mixture, Recipe

_MEAN_STRETCH = 15
"""Steps, on average, until it is drawn anew who drives."""
_VISITED_SHARD = 1 << 20
"""Far from the shard numbers of `collect`, so that equal runs do not share their episodes' seeds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Company:
    """Who else has a say in what is executed."""

    mix: float = 0.0
    """Share of the steps in which the expert drives, in stretches of some 15 steps."""
    levels: tuple[float, ...] = (0.0,)
    """How strongly the policy's actions are perturbed (`perturbation`): one for each episode, as likely."""


DAGGER = Company(mix=0.1)


class BatchPolicy(Protocol):
    """Acts in E episodes at once and keeps a memory of each."""

    def __call__(
        self, masks: NDArray[np.uint8], last_actions: NDArray[np.float32], resets: NDArray[np.bool_]
    ) -> NDArray[np.float32]:
        """Return the actions (E, 2) in [-1, 1].

        Args:
            masks: (E, 64, 64), classes.
            last_actions: (E, 2), what was executed in the step before, by whomever; zeros at a reset.
            resets: (E,), an episode begins: forget the one before.
        """


def collect_visited(
    recipe: Recipe | Mixture,
    policy: BatchPolicy,
    *,
    steps: int,
    out_dir: Path,
    seed: int,
    company: Company = DAGGER,
    envs: int = 32,
    progress: Callable[[int], None] | None = None,
) -> None:
    """Write shards of states that a policy visited, `steps` steps in all; the last episodes are cut short.

    Args:
        recipe: what the episodes are drawn from.
        policy: called once a step.
        steps: how many.
        out_dir: made where it is missing; must hold no shards yet.
        seed: use another one for every round; equal seeds and policies give equal data.
        company: who else has a say.
        envs: E.
        progress: called now and then with the number of steps on disk.

    Raises:
        UsageError: the folder holds shards, or a world or body is not installed.
    """
    out_dir.mkdir(parents=True, exist_ok=True)
    if any(out_dir.glob("shard-*.npz")):
        raise UsageError(f"{out_dir}: holds shards already; name another folder")
    waiting: list[Record] = []
    index = written = 0

    def write() -> None:
        nonlocal waiting, index, written
        shard = joined_shard(f"{recipe.name} visited, seed {seed}", waiting)
        write_shard(out_dir / shard_name(index), shard)
        waiting, index, written = [], index + 1, written + len(shard.steps)
        if progress is not None:
            progress(written)

    for record in visit(recipe, policy, steps=steps, seed=seed, company=company, envs=envs):
        waiting.append(record)
        if sum(header.steps for header, _ in waiting) >= SHARD_STEPS:
            write()
    if waiting:
        write()


def visit(
    recipe: Recipe | Mixture,
    policy: BatchPolicy,
    *,
    steps: int,
    seed: int,
    company: Company = DAGGER,
    envs: int = 32,
) -> Iterator[Record]:
    """Yield episodes as they end, `steps` steps in all; see `collect_visited`."""
    rng = np.random.default_rng([seed, 0xDA66])
    slots = [_Slot(recipe, company, seed, index) for index in range(min(envs, steps))]
    last_actions = np.zeros((len(slots), 2), np.float32)
    resets = np.ones(len(slots), bool)
    made = 0
    while made < steps:
        masks = np.stack([slot.rollout.mask for slot in slots])
        answers = policy(masks, last_actions, resets)
        for index, slot in enumerate(slots[: steps - made]):
            rollout = slot.rollout
            last_actions[index] = slot.step(answers[index], rng)
            resets[index] = rollout.ended
            if rollout.ended:
                yield rollout.record()
                slot.begin()
                last_actions[index] = 0.0
        made += len(slots[: steps - made])
    yield from (slot.rollout.record() for slot in slots if len(slot.rollout))


class _Slot:
    """One of the places where an episode is under way; its episodes follow each other."""

    def __init__(self, recipe: Recipe | Mixture, company: Company, seed: int, index: int) -> None:
        self._recipe = recipe
        self._company = company
        self._place = (seed, _VISITED_SHARD + index)
        self._episodes = 0
        self._expert_drives = False
        self.begin()

    def begin(self) -> None:
        """Begin the next episode."""
        episode = training_seed(*self._place, self._episodes)
        spec = self._recipe.draw(episode)
        self.rollout = Rollout(spec, self._recipe.episode_steps, self._recipe.expert)
        self._perturbation = Perturbation.drawn(episode, levels=self._company.levels)
        self._episodes += 1

    def step(self, answer: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
        """Execute the policy's answer or the expert's; return what it was, within [-1, 1]."""
        if rng.random() < 1.0 / _MEAN_STRETCH:
            self._expert_drives = bool(rng.random() < self._company.mix)
        perturbed = self._perturbation(answer)
        action = np.clip(self.rollout.expert if self._expert_drives else perturbed, -1.0, 1.0)
        self.rollout.step(action)
        return action
