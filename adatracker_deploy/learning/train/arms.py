"""Variants of the ablation: what each leaves out, and the training of one variant from one seed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from adatracker_deploy.learning.export import export_checkpoint
from adatracker_deploy.learning.train.run import train
from adatracker_deploy.learning.train.snapshot import (
    POLICY_NAME,
    SNAPSHOT_NAME,
    check_same_run,
    read_snapshot,
)

if TYPE_CHECKING:
    from adatracker_deploy.learning.train.settings import TrainSettings, Variant

WHOLE = "whole"
ARMS: dict[str, tuple[Variant, ...]] = {
    WHOLE: (),
    "no-encoder": ("no-encoder",),
    "no-last-action": ("no-last-action",),
    "neither": ("no-encoder", "no-last-action"),
    "no-identification": ("no-identification",),
    "no-dynamics": ("no-dynamics",),
    "no-consistency": ("no-consistency",),
    "no-lstm": ("no-lstm",),
    "no-search": ("no-search",),
    "no-belief": (),
    "no-response": (),
}
"""By name: what is left out. `no-encoder` gets its last action instead of a context, the response included,
`no-last-action` is the paper's policy, `neither` is Offline EVT's on the same data."""

BUNDLE_NAME = "bundle"


def train_arm(settings: TrainSettings, data: list[Path], folder: Path) -> Path:
    """Train and export one arm, or go on where it was interrupted, and return its bundle's folder.

    Args:
        settings: with what the arm leaves out.
        data: folders of shards.
        folder: of this arm and seed; a finished bundle in it is kept.

    Raises:
        UsageError: the folder holds another run, or see `train`.
    """
    bundle = folder / BUNDLE_NAME
    begun = read_snapshot(folder) if (folder / SNAPSHOT_NAME).exists() else None
    if begun is not None:
        check_same_run(begun, settings, begun.data_steps, folder)
    if begun is None or begun.update < settings.updates or not bundle.exists():
        torch.set_num_threads(1)
        train(
            settings,
            data,
            folder,
            resume=begun is not None,
            say=lambda _text: None,
            tell=lambda _update, _loss: None,
        )
        export_checkpoint(folder / POLICY_NAME, bundle, name="-".join(folder.parts[-2:]), force=True)
    return bundle


def of_arm(settings: TrainSettings, arm: str, seed: int) -> TrainSettings:
    """Return the settings of an arm's run from a training seed: the whole's, less what the arm leaves out."""
    variants = tuple(sorted({*settings.variants, *ARMS[arm]}))
    belief = settings.belief and arm != "no-belief"
    response = settings.response and arm != "no-response" and "no-encoder" not in variants
    return replace(settings, variants=variants, belief=belief, response=response, seed=seed)


def arms_of(settings: TrainSettings) -> list[str]:
    """Return the arms that leave something out of what these settings train, one of each that are the same.

    Only DAgger's labels search.
    """
    known = [of_arm(settings, WHOLE, 0)]
    found = []
    for arm in ARMS:
        run = of_arm(settings, arm, 0)
        if run not in known and (arm != "no-search" or settings.method == "dagger"):
            known.append(run)
            found.append(arm)
    return found
