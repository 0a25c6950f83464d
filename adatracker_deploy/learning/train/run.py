"""One training run in one folder: rounds of updates, visits between them, snapshots for resuming.

    training.pt   the latest snapshot       curves.csv     what the losses did
    policy.pt     the policy as it stands   visited-N/     what was visited for round N

Every batch and every draw follows from the seed and the number of the update. So a run that was interrupted
and resumed ends in the same weights, on the CPU to the bit, as one that was not.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from adatracker_deploy.core.errors import UsageError, line_of
from adatracker_deploy.learning.bundle_weights import networks_of
from adatracker_deploy.learning.checkpoint import ADATRACKER_MASK, one_driver
from adatracker_deploy.learning.data.dataset import Dataset
from adatracker_deploy.learning.data.recipe import load_mixture
from adatracker_deploy.learning.episode_spec import RATE_HZ
from adatracker_deploy.learning.tracking import ACTION
from adatracker_deploy.learning.train.agent import Agent, Sequences, inputs_of, statistics_of
from adatracker_deploy.learning.train.awr import Awr
from adatracker_deploy.learning.train.cloning import Cloning
from adatracker_deploy.learning.train.cql_sac import CqlSac
from adatracker_deploy.learning.train.curves import Curves, MetricLogger
from adatracker_deploy.learning.train.dagger import Dagger
from adatracker_deploy.learning.train.method import Learner, Say, check_bfloat16
from adatracker_deploy.learning.train.settings import TrainSettings
from adatracker_deploy.learning.train.snapshot import (
    POLICY_NAME,
    SNAPSHOT_NAME,
    Snapshot,
    check_same_run,
    read_snapshot,
    write_policy,
    write_snapshot,
)
from adatracker_deploy.learning.train.td3 import Td3
from adatracker_deploy.learning.train.visitor import visit_round
from adatracker_deploy.policy.catalogue import find_bundle

if TYPE_CHECKING:
    from torch import Tensor

    from adatracker_deploy.learning.data.visit import Company
    from adatracker_deploy.learning.networks import AdaTrackerConfig
    from adatracker_deploy.policy.bundle import Bundle

SNAPSHOT_EVERY_S = 120.0
_INPUTS = "policy.memory.weight_ih_l0"
"""What the policy's LSTM makes of its inputs."""

Tell = Callable[[int, float], None]
"""Told, after an update, how many were made and the last loss."""


def train(
    settings: TrainSettings,
    data: list[Path],
    out: Path,
    *,
    resume: bool = False,
    device: str = "cpu",
    workers: int = 1,
    say: Say,
    tell: Tell,
    open_loggers: Callable[[], Sequence[MetricLogger]] = tuple,
) -> Path:
    """Train until the last update and return the policy's checkpoint.

    Args:
        settings: of the run.
        data: folders of shards to begin with, or of logged trials.
        out: the run's folder, made where it is missing.
        resume: go on with the run in `out`.
        device: where torch computes.
        workers: processes that visit.
        say: see `method.Say`.
        tell: see `Tell`.
        open_loggers: asked once the request is known to be right for what keeps the curves, besides
            ``curves.csv`` and TensorBoard.

    Raises:
        UsageError: the folder holds a run and `resume` is off, or holds none and it is on; the settings or
            the data are not that run's; the data cannot be read; no such device or recipe; the run to begin
            with is missing or has other networks; `dagger` is to learn from logged trials.
        KeyboardInterrupt: the run was interrupted, and is saved.
    """
    if not resume and (out / SNAPSHOT_NAME).exists():
        raise UsageError(f"{out}: holds a run; go on with it by --resume, or name another folder")
    snapshot = read_snapshot(out) if resume else None
    load_mixture(settings.recipe)
    base = Dataset.open(data)
    settings = replace(settings, logs=base.logged)
    lacking = {"dagger": "asks an expert, whom", "td3": "learns from the true state, which"}
    if base.logged and settings.method in lacking:
        raise UsageError(
            f"--method {settings.method}: {lacking[settings.method]} logged trials do not have; "
            "cloning, awr and cql_sac learn from what was done"
        )
    if settings.late and not (settings.method == "td3" and settings.response):
        raise UsageError("--late: only --method td3 --response makes a driver of bodies that obey late")
    if settings.method == "td3":
        _check_improves(settings)
    if snapshot is not None:
        check_same_run(snapshot, settings, len(base), out)
    learner = _learner(settings, device)
    if snapshot is not None:
        _go_on(learner, snapshot, out)
    elif settings.init is not None:
        _begin_with(learner.agent, settings.init, late=settings.late)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{out}: cannot be made: {error}") from error
    update = snapshot.update if snapshot else 0
    run = _Run(settings, out, learner, update=update, base=base, workers=workers)
    run.all_rounds(say, tell, open_loggers())
    return out / POLICY_NAME


def _learner(settings: TrainSettings, device: str) -> Learner:
    torch.manual_seed(settings.seed)
    agent = Agent(settings.config())
    try:
        agent.to(device)
    except (RuntimeError, AssertionError) as error:
        raise UsageError(f"device {device!r} cannot be used: {line_of(error)}") from error
    if settings.bfloat16:
        check_bfloat16(device)
    agent.train()
    learners: dict[str, Callable[[Agent, TrainSettings], Learner]] = {
        "dagger": Dagger,
        "cloning": Cloning,
        "awr": Awr,
        "td3": Td3,
        "cql_sac": CqlSac,
    }
    return learners[settings.method](agent, settings)


def _go_on(learner: Learner, snapshot: Snapshot, out: Path) -> None:
    """Take up a run.

    Raises:
        UsageError: its networks are not those of today.
    """
    try:
        learner.load_state_dict(snapshot.learner)
    except (KeyError, RuntimeError, ValueError) as error:  # as torch tells of other parts, shapes and counts
        if isinstance(error, RuntimeError) and "loading state_dict" not in str(error):
            raise  # a device without memory, say
        raise UsageError(
            f"{out}: its run was begun by another version, whose {snapshot.settings.method} had other "
            "networks; begin anew in another folder"
        ) from error


def _check_improves(settings: TrainSettings) -> None:
    """Refuse what `td3` makes nothing of.

    Raises:
        UsageError: there is no policy to improve, or a part that it does not train is to be left out.
    """
    if settings.init is None:
        raise UsageError("--method td3: improves a policy that can drive; name its run or bundle by --init")
    for variant in settings.variants:
        if variant not in ("no-encoder", "no-lstm", "no-last-action"):
            raise UsageError(f"--variant {variant}: td3 leaves the encoder as it is, and has no labels")


def _begin_with(agent: Agent, other: str, *, late: bool) -> None:
    """Take over the networks of another run's folder, or of a bundle.

    An agent that is told a belief or a response may begin with networks that are not: it ignores it at first.
    Of a bundle with two drivers it takes the one for bodies that obey `late`, or the usual one.

    Raises:
        UsageError: there is neither, or its networks differ.
    """
    if (Path(other) / SNAPSHOT_NAME).exists():
        found = read_snapshot(Path(other))
        config, weights = found.settings.config(), found.learner["agent"]
    else:
        networks = networks_of(_bundle(other))
        policy = one_driver(networks.policy, late=late)
        meta, config = networks.meta, policy.config
        if (meta.mask, meta.action, meta.rate_hz) != (ADATRACKER_MASK, ACTION, RATE_HZ):
            raise UsageError(
                f"{other}: its masks, its action or its rate are not those that are trained here"
            )
        known = {"policy": policy, "encoder": networks.encoder}
        weights = agent.state_dict() | {
            f"{part}.{name}": value
            for part, module in known.items()
            if module is not None
            for name, value in module.state_dict().items()
        }
    before = config
    if config.lstm and agent.config.lstm:
        config = replace(
            config,
            belief=config.belief or agent.config.belief,
            response=config.response or agent.config.response,
        )
    for field in fields(config):
        theirs, ours = getattr(config, field.name), getattr(agent.config, field.name)
        if theirs != ours:
            raise UsageError(f"{other}: its networks differ: {field.name} {theirs!r}, not {ours!r}")
    if config != before:
        weights = weights | {_INPUTS: _widened(weights[_INPUTS], before, config)}
    agent.load_state_dict(weights)


def _widened(weights: Tensor, before: AdaTrackerConfig, after: AdaTrackerConfig) -> Tensor:
    """Return the weights of a layer over the inputs `after`, zeros for those that it had not `before`."""
    widths = [width for width in before.inputs.values() if width]
    parts = iter(torch.split(weights, widths, dim=1))
    columns = [
        next(parts) if before.inputs[name] else weights.new_zeros(len(weights), width)
        for name, width in after.inputs.items()
        if width
    ]
    return torch.cat(columns, dim=1)


def _bundle(name_or_dir: str) -> Bundle:
    try:
        return find_bundle(name_or_dir)
    except UsageError as error:
        raise UsageError(
            f"{name_or_dir}: holds no {SNAPSHOT_NAME} of a run, and is no bundle: {error}"
        ) from error


class _Run:
    def __init__(
        self,
        settings: TrainSettings,
        out: Path,
        learner: Learner,
        *,
        update: int,
        base: Dataset,
        workers: int,
    ) -> None:
        self._settings = settings
        self._out = out
        self._learner = learner
        self._update = update
        self._dataset = self._labelled(base)
        self._base_steps = len(base)
        self._rounds = 0
        """Whose visits are in `_dataset`."""
        self._workers = workers
        self._saved_s = time.monotonic()

    def all_rounds(self, say: Say, tell: Tell, loggers: Sequence[MetricLogger]) -> None:
        if self._update == 0:
            self._save()  # so that whatever interrupts it, there is something to resume
        if self._learner.prepare(self._dataset, say):
            self._save()
        curves = Curves(self._out, self._update, loggers)
        company = self._learner.visits
        rounds = self._settings.rounds if company else 0
        try:
            for number in range(rounds + 1):
                end = self._settings.updates * (number + 1) // (rounds + 1)
                if self._update >= end:
                    continue
                if number and company:
                    self._visit(number, company, say)
                say(f"round {number} of {rounds}: {len(self._dataset)} steps of data, to update {end}")
                self._improve(end, curves, tell)
        finally:
            curves.close()

    def _visit(self, number: int, company: Company, say: Say) -> None:
        """Check that the data of all rounds up to this one are there, and load them."""
        settings = self._settings
        folders = [self._out / f"visited-{index}" for index in range(1, number + 1)]
        say(f"round {number}: visiting {settings.round_steps} steps")
        visit_round(
            self._learner.agent,
            load_mixture(settings.recipe),
            steps=settings.round_steps,
            folder=folders[-1],
            seed=[settings.seed, number],
            workers=self._workers,
            company=company,
        )
        visited = Dataset.open(folders[-1:])
        reward = float(visited.steps.rewards.mean())
        lost = float(visited.steps.done.sum() / len(visited.headers))
        say(f"round {number}: reward {reward:.3f} a step, {lost:.1%} of the episodes lost")
        for folder in folders[self._rounds :]:
            self._dataset = self._dataset.followed_by(self._labelled(Dataset.open([folder])))
        self._rounds = number

    def _labelled(self, data: Dataset) -> Dataset:
        settings = self._settings
        searches = settings.method == "dagger" and "no-search" not in settings.variants
        if settings.belief or settings.response:
            data = data.told(believes=settings.belief, responds=settings.response)
        if settings.front == "pooled":
            data = data.with_statistics(statistics_of(data.steps.masks))
        if self._learner.reads_inputs:
            data = data.with_inputs(inputs_of(self._learner.agent, data))
        return data.searching() if searches else data

    def _improve(self, end: int, curves: Curves, tell: Tell) -> None:
        """Make updates until `end`; the next batch is prepared while torch computes."""
        device = next(self._learner.agent.parameters()).device
        with ThreadPoolExecutor(1) as ahead, _interruptible() as interrupted:
            waiting = ahead.submit(self._sequences, self._update)
            while self._update < end:
                sequences = waiting.result().to(device)
                waiting = ahead.submit(self._sequences, self._update + 1)
                values = self._learner.update(sequences, self._update)
                self._update += 1
                curves.add(self._update, values)
                tell(self._update, float(values["loss"]))
                if interrupted.is_set():
                    self._save()
                    raise KeyboardInterrupt
                if time.monotonic() - self._saved_s > SNAPSHOT_EVERY_S:
                    self._save()
            self._save()

    def _sequences(self, update: int) -> Sequences:
        rng = np.random.default_rng([self._settings.seed, update])
        settings = self._settings
        past = max(self._learner.agent.config.history, 1)  # the last action is in it
        return Sequences.of(self._dataset.sample(rng, settings.batch, settings.length, past))

    def _save(self) -> None:
        write_snapshot(
            self._out,
            Snapshot(
                settings=self._settings,
                data_steps=self._base_steps,
                update=self._update,
                learner=self._learner.state_dict(),
            ),
        )
        write_policy(self._out, self._learner.agent, self._settings, self._update)
        self._saved_s = time.monotonic()


@contextmanager
def _interruptible() -> Iterator[threading.Event]:
    """Turn Ctrl-C into an event, so that no update is cut in half; a second one interrupts at once."""
    asked = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield asked
        return

    def ask(_signal: int, _frame: object) -> None:
        if asked.is_set():
            raise KeyboardInterrupt
        asked.set()

    before = signal.signal(signal.SIGINT, ask)
    try:
        yield asked
    finally:
        signal.signal(signal.SIGINT, before)
