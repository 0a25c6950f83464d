"""Untrained checkpoints that are small, and loud: every input tells in every answer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch

from adatracker_deploy.learning.checkpoint import ADATRACKER_MASK, AdaTracker, CheckpointMeta, save_checkpoint
from adatracker_deploy.learning.networks import (
    AdaTrackerConfig,
    ContextEncoder,
    ContextPolicy,
    OfflineEvtPolicy,
)
from adatracker_deploy.policy.base import ActionAxis

CONFIG = AdaTrackerConfig(size=32, history=5, features=12, context=4, encoder_hidden=10, hidden=8, actor=16)
VARIANTS = {
    "last action": replace(CONFIG, last_action=True),
    "no encoder": replace(CONFIG, history=0, context=0),
    "no encoder, last action": replace(CONFIG, history=0, context=0, last_action=True),
    "no lstm": replace(CONFIG, lstm=False),
    "belief": replace(CONFIG, last_action=True, belief=True),
    "response": replace(CONFIG, last_action=True, belief=True, response=True),
    "second driver": replace(CONFIG, last_action=True, belief=True, response=True, second_driver=True),
    "no encoder, belief": replace(CONFIG, history=0, context=0, belief=True),
    "pooled": replace(CONFIG, last_action=True, front="pooled"),
}
META = CheckpointMeta(
    name="fresh",
    mask=replace(ADATRACKER_MASK, size=CONFIG.size, draw_size=80),
    action=(ActionAxis(axis="forward"), ActionAxis(axis="yaw", sign=-1)),
    rate_hz=10.0,
    training="Not trained.",
    licence="Apache-2.0",
)


def _loud(module: torch.nn.Module) -> None:
    with torch.no_grad():
        for weight in module.parameters():
            weight.mul_(2.0)


def adatracker(seed: int = 0, config: AdaTrackerConfig = CONFIG) -> AdaTracker:
    torch.manual_seed(seed)
    encoder = ContextEncoder(config).eval() if config.context else None
    policy = ContextPolicy(config).eval()
    if encoder is not None:
        _loud(encoder)
    _loud(policy)
    return AdaTracker(encoder, policy, META)


def save_adatracker(
    path: Path, seed: int = 0, meta: CheckpointMeta = META, config: AdaTrackerConfig = CONFIG
) -> Path:
    checkpoint = adatracker(seed, config)
    save_checkpoint(path, checkpoint.encoder, checkpoint.policy, meta)
    return path


def save_offline_evt(path: Path) -> Path:
    torch.manual_seed(0)
    critic = {"critic1.fc1.weight": torch.zeros(256, 66)}
    torch.save(OfflineEvtPolicy().state_dict() | critic, path)
    return path
