"""Rolls out the agent in many episodes at once, for methods that visit."""

from __future__ import annotations

import copy
import math
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.learning.data.recipe import Mixture, Recipe
from adatracker_deploy.learning.data.visit import DAGGER, Company, collect_visited
from adatracker_deploy.learning.data.workers import in_processes
from adatracker_deploy.learning.episode_spec import RATE_HZ
from adatracker_deploy.learning.tracking import ACTION
from adatracker_deploy.learning.train.agent import Agent, drawn
from adatracker_deploy.policy.past import Past

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from adatracker_deploy.learning.drivers import LstmState


class Visitor:
    """A `BatchPolicy`: answers one step of E episodes, as a bundle would answer each alone."""

    def __init__(self, agent: Agent) -> None:
        self._agent = agent
        self._device = next(agent.parameters()).device
        with torch.no_grad():
            config = agent.config
            blank = torch.zeros(1, 1, config.channels, config.size, config.size, device=self._device)
            self._blank = agent.policy.backbone.sequences(blank)
        self._features = self._blank[:, 0]
        self._pairs: Tensor | None = None
        self._past: Past | None = None
        self._state: LstmState | None = None

    @torch.no_grad()
    def __call__(
        self, masks: NDArray[np.uint8], last_actions: NDArray[np.float32], resets: NDArray[np.bool_]
    ) -> NDArray[np.float32]:
        """Return the actions (E, A); see `BatchPolicy`."""
        policy, encoder = self._agent.policy, self._agent.encoder
        last = torch.from_numpy(last_actions).to(self._device)
        forget = torch.from_numpy(resets).to(self._device)
        beliefs, responses = self._told(masks, last_actions, resets)
        z = None
        if encoder is not None:
            z = encoder.summarise(self._remembered(last, forget))[:, None]
            z = torch.cat((z, responses), dim=-1)
        self._features = policy.backbone(drawn(masks).to(self._device))
        if self._state is not None:
            self._state = (
                self._state[0].masked_fill(forget[None, :, None], 0.0),
                self._state[1].masked_fill(forget[None, :, None], 0.0),
            )
        told = last[:, None] if self._agent.config.last_action else None
        believed = beliefs if self._agent.config.belief else None
        x, self._state = policy.recall(self._features[:, None], z, self._state, told, believed)
        mean, _ = policy.actor(x[:, 0])
        actions: NDArray[np.float32] = torch.tanh(mean).cpu().numpy()
        return actions

    def _told(
        self, masks: NDArray[np.uint8], last_actions: NDArray[np.float32], resets: NDArray[np.bool_]
    ) -> tuple[Tensor, Tensor]:
        """Return beliefs (E, 1, `belief.SIZE`) and responses (E, 1, `response.SIZE`), one step on."""
        config = self._agent.config
        if self._past is None:
            self._past = Past(
                len(masks), believes=config.belief, responds=config.response, period_s=1.0 / RATE_HZ
            )
        self._past.forget(resets)
        told = self._past.see(masks == MaskClass.TARGET, last_actions, ACTION)
        beliefs, responses = (torch.from_numpy(values[:, None]).to(self._device) for values in told)
        return beliefs, responses

    def _remembered(self, last: Tensor, forget: Tensor) -> Tensor:
        """Return the K pairs (E, K, F + A) that z is made of, the step before's the newest."""
        config, count = self._agent.config, len(last)
        unknown = torch.zeros(1, 1, config.actions, device=self._device)
        blank = torch.cat((self._blank, unknown), dim=-1)
        if self._pairs is None:
            self._pairs = blank.repeat(count, config.history, 1)
        newest = torch.cat((self._features.expand(count, -1), last), dim=-1)
        pairs = torch.cat((self._pairs[:, 1:], newest[:, None]), dim=1)
        self._pairs = torch.where(forget[:, None, None], blank, pairs)
        return self._pairs


_AT_ONCE = 16
"""Episodes that a part of a round steps together: networks gain by more, an interrupt waits longer for it."""


def visit_round(
    agent: Agent,
    recipe: Recipe | Mixture,
    *,
    steps: int,
    folder: Path,
    seed: list[int],
    workers: int,
    company: Company = DAGGER,
) -> list[Path]:
    """Fill a folder with the states that an agent visits, and return the folders of its parts.

    Parts that are there already are kept; any number of workers leaves the same files.

    Args:
        agent: not changed; a copy of it drives on the CPU.
        recipe: what the episodes are drawn from.
        steps: in all, in parts of one full episode in each of `_AT_ONCE` places.
        folder: made where it is missing.
        seed: any numbers that name the round.
        workers: processes.
        company: who else has a say.
    """
    size = _AT_ONCE * recipe.episode_steps
    parts = [folder / f"part-{index:03d}" for index in range(math.ceil(steps / size))]
    driver = copy.deepcopy(agent).cpu()
    jobs = [
        (driver, recipe, company, min(size, steps - index * size), [*seed, index], part)
        for index, part in enumerate(parts)
        if not part.exists()
    ]
    for _ in in_processes(_visit_part, jobs, workers):
        pass
    return parts


def _visit_part(  # noqa: PLR0917 - a job's arguments go by place
    agent: Agent, recipe: Recipe | Mixture, company: Company, steps: int, seed: list[int], part: Path
) -> None:
    """Make one part; the folder appears under its name when it is complete."""
    unfinished = part.with_name(f".{part.name}")
    shutil.rmtree(unfinished, ignore_errors=True)
    number = int(np.random.SeedSequence(seed).generate_state(1)[0])
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # in a worker or not: its answers must be the same to the bit
    try:
        collect_visited(
            recipe,
            Visitor(agent),
            steps=steps,
            out_dir=unfinished,
            seed=number,
            company=company,
            envs=_AT_ONCE,
        )
    finally:
        torch.set_num_threads(threads)
    unfinished.rename(part)
