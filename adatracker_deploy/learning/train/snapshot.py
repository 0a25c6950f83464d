"""A run on disk: snapshots for resuming, and the current policy."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from adatracker_deploy.config.schema import parse
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.checkpoint import (
    ADATRACKER_MASK,
    CheckpointMeta,
    load_values,
    save_checkpoint,
)
from adatracker_deploy.learning.episode_spec import RATE_HZ
from adatracker_deploy.learning.tracking import ACTION
from adatracker_deploy.learning.train.agent import Agent
from adatracker_deploy.learning.train.settings import TrainSettings

SNAPSHOT_NAME, POLICY_NAME = "training.pt", "policy.pt"
_FORMAT = "adatracker-training-1"


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """All that the rest of a run depends on; what is drawn at random follows from the seed and `update`."""

    settings: TrainSettings
    data_steps: int
    """Number of steps in the data set that the run began with."""
    update: int
    """Number of updates made."""
    learner: dict[str, Any]


def write_snapshot(out: Path, snapshot: Snapshot) -> None:
    """Write a snapshot; the last one stays until this one is complete."""
    content = {
        "format": _FORMAT,
        "settings": dataclasses.asdict(snapshot.settings),
        "data_steps": snapshot.data_steps,
        "update": snapshot.update,
        "learner": snapshot.learner,
    }
    _replaced(out / SNAPSHOT_NAME, lambda path: torch.save(content, path))


def read_snapshot(out: Path) -> Snapshot:
    """Read a run's snapshot.

    Raises:
        UsageError: there is none, or it cannot be read.
    """
    path = out / SNAPSHOT_NAME
    if not path.is_file():
        raise UsageError(
            f"{out}: holds no {SNAPSHOT_NAME} to resume; leave out --resume to begin a run there"
        )
    content = load_values(path)
    if not isinstance(content, dict) or content.get("format") != _FORMAT:
        raise UsageError(f"{path}: is not a snapshot that this version reads ({_FORMAT})")
    return Snapshot(
        settings=parse(TrainSettings, content["settings"], where=f"{path}: settings"),
        data_steps=content["data_steps"],
        update=content["update"],
        learner=content["learner"],
    )


def check_same_run(snapshot: Snapshot, settings: TrainSettings, data_steps: int, out: Path) -> None:
    """Refuse to go on with other settings or data than a run began with.

    Raises:
        UsageError: one line that names the first difference.
    """
    for field in dataclasses.fields(settings):
        was, now = getattr(snapshot.settings, field.name), getattr(settings, field.name)
        if was != now:
            raise UsageError(f"{out}: its run has {field.name} {was!r}, not {now!r}; resume it with the same")
    if snapshot.data_steps != data_steps:
        raise UsageError(
            f"{out}: its run began with {snapshot.data_steps} steps of data, not {data_steps}; "
            "resume it with the same --data"
        )


def write_policy(out: Path, agent: Agent, settings: TrainSettings, update: int) -> None:
    """Write the policy as it stands, for export."""
    told = {
        "pooled front": settings.front == "pooled",
        "belief": settings.belief,
        "response": settings.response,
    }
    parts = (*settings.variants, *(name for name, has in told.items() if has))
    apart = f", {', '.join(parts)}" if parts else ""
    source = "logged trials" if settings.logs else f"recipe {Path(settings.recipe).stem}"
    meta = CheckpointMeta(
        name=f"adatracker_{settings.method}",
        mask=ADATRACKER_MASK,
        action=ACTION,
        rate_hz=RATE_HZ,
        training=(
            f"{settings.method}, {source}{apart}\n"
            f"{update} updates of {settings.batch} x {settings.length} steps, seed {settings.seed}."
        ),
        licence="Apache-2.0",
    )
    _replaced(out / POLICY_NAME, lambda path: save_checkpoint(path, agent.encoder, agent.policy, meta))


def _replaced(path: Path, write: Callable[[Path], None]) -> None:
    unfinished = path.with_name(f".{path.name}")
    try:
        write(unfinished)
        unfinished.replace(path)
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error}") from error
