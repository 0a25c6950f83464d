"""The gap between `cql_sac` and cloning on equal data and updates, one difference at a time.

python benchmarks/offline_rl.py --data DIR --out DIR [--updates 1500] [--seed 1] [--arm NAME ...]

Each arm is a run on the same shards, batches and networks, interrupted and resumed like any other:

    clone-clean      cloning of the expert's clean action (`dagger` without rounds or search labels)
    clone-executed   cloning of the action that was executed: noise and perturbations included
    cql_sac          the paper's method
    cql_sac-fast     its actor learns at the critics' rate, ten times its own
    cql_sac-cloned   its critics shape the networks, but its actor clones the clean action on their features,
                     which it does not move: do the features hold what is to be known?

Then, over batches that no run drew: how far an arm's action is from the clean one and from the executed one
(root mean square, of a range of 2), and of critics what they hold better: Q at the clean action less Q at
the executed one, and the share of steps at which it is greater. Episodes decide: bundles are left for
``adatracker-deploy evaluate --policy DIR/clone-clean/bundle ... --condition field``.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import torch
from torch import Tensor, nn

from adatracker_deploy.learning.data.dataset import Dataset
from adatracker_deploy.learning.export import export_checkpoint
from adatracker_deploy.learning.losses import cloning_loss, mean_where
from adatracker_deploy.learning.train import cql_sac, run
from adatracker_deploy.learning.train.agent import Agent, Sequences
from adatracker_deploy.learning.train.cql_sac import CqlSac, Transitions
from adatracker_deploy.learning.train.dagger import Dagger
from adatracker_deploy.learning.train.method import Learner, counted
from adatracker_deploy.learning.train.settings import TrainSettings
from adatracker_deploy.learning.train.snapshot import SNAPSHOT_NAME, read_snapshot

BATCHES, SIDE_SEED = 12, 987_654
"""Number and seed of the batches on which arms are compared; no run draws from this seed."""


class ExecutedClone(Dagger):
    """Clones what was done, not what the expert wanted."""

    def update(self, sequences: Sequences, number: int) -> dict[str, Tensor]:
        return super().update(replace(sequences, experts=executed(sequences)), number)


class FastActor(CqlSac):
    """The actor and the entropy weight learn as fast as the critics."""

    def __init__(self, agent: Agent, settings: TrainSettings) -> None:
        with patch.object(cql_sac, "_ACTOR_RATE", cql_sac._RATE):
            super().__init__(agent, settings)


class ClonedActor(FastActor):
    """The networks as the critics left them, read out by cloning."""

    def update(self, sequences: Sequences, number: int) -> dict[str, Tensor]:
        self._wanted, self._counted = sequences.experts[:, :-1], counted(sequences)[:, :-1]
        return super().update(sequences, number)

    def _improve_actor(self, steps: Transitions) -> tuple[Tensor, Tensor]:
        mean, _ = self.agent.policy.actor(steps.x.detach())
        loss = cloning_loss(mean, self._wanted, self._counted)
        self._actor_optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self.agent.policy.actor.parameters(), cql_sac._CLIP)
        self._actor_optimizer.step()
        return loss, torch.zeros(())


ARMS: dict[str, type[Dagger] | type[CqlSac]] = {
    "clone-clean": Dagger,
    "clone-executed": ExecutedClone,
    "cql_sac": CqlSac,
    "cql_sac-fast": FastActor,
    "cql_sac-cloned": ClonedActor,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--updates", type=int, default=1500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--arm", choices=ARMS, action="append")
    options = parser.parse_args()
    torch.set_num_threads(1)
    print("arm               updates  rms to clean  rms to executed   Q clean - executed  clean above")
    for arm in options.arm or ARMS:
        learner = trained(arm, options)
        errors, worth = compared(learner, Dataset.open([options.data]))
        numbers = f"{errors[0]:12.3f}{errors[1]:17.3f}" + (
            "" if worth is None else "{:21.3f}{:12.0%}".format(*worth)
        )
        print(f"{arm:16}{options.updates:9}  {numbers}", flush=True)


def trained(arm: str, options: argparse.Namespace) -> Learner:
    """Train an arm, or go on with it, and leave its bundle beside it."""
    kind, folder = ARMS[arm], options.out / arm
    settings = TrainSettings(
        recipe="deploy",
        method="dagger" if issubclass(kind, Dagger) else "cql_sac",
        variants=("no-search",),
        seed=options.seed,
        updates=options.updates,
        rounds=0,
    )
    begun = (folder / SNAPSHOT_NAME).exists()
    learners: list[Learner] = []

    def build(settings: TrainSettings, _device: str) -> Learner:
        torch.manual_seed(settings.seed)
        agent = Agent(settings.config())
        agent.train()
        learners.append(kind(agent, settings))
        return learners[-1]

    with patch.object(run, "_learner", build):
        if not begun or read_snapshot(folder).update < settings.updates:
            policy = run.train(
                settings, [options.data], folder, resume=begun, say=lambda _: None, tell=lambda *_: None
            )
            export_checkpoint(policy, folder / "bundle", name=arm, force=True)
        else:
            build(settings, "cpu").load_state_dict(read_snapshot(folder).learner)
    return learners[-1]


@torch.no_grad()
def compared(learner: Learner, data: Dataset) -> tuple[tuple[float, ...], tuple[float, float] | None]:
    """Return the errors to the clean and the executed action, and what critics hold of the two."""
    agent, rows = learner.agent, []
    agent.eval()
    for number in range(BATCHES):
        rng = np.random.default_rng([SIDE_SEED, number])
        sequences = Sequences.of(data.sample(rng, 16, 48, max(agent.config.history, 1)))
        x, weight = agent.recall(sequences).x, counted(sequences)
        action = torch.tanh(agent.policy.actor(x)[0])
        clean, done = sequences.experts, executed(sequences)
        values = [((action - other) ** 2).mean(-1) for other in (clean, done)]
        if isinstance(learner, CqlSac):
            q = [torch.minimum(*(critic(x, given) for critic in learner.critics)) for given in (clean, done)]
            values += [q[0] - q[1], (q[0] > q[1]).float()]
        rows.append([float(mean_where(value, weight)) for value in values])
    means = np.mean(rows, axis=0)
    return tuple(np.sqrt(means[:2])), tuple(means[2:]) if len(means) > 2 else None


def executed(sequences: Sequences) -> Tensor:
    """Return the actions that were executed, (B, L, A)."""
    return sequences.actions[:, -sequences.experts.shape[1] :]


if __name__ == "__main__":
    main()
