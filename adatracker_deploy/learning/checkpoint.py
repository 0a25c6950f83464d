"""Checkpoints: written by training, read by export.

    {"format": "adatracker", "config": AdaTrackerConfig, "meta": CheckpointMeta, "state_dict": tensors}

as plain mappings, or the published state dict of Offline EVT. Nothing but tensors and plain values is loaded.
"""

from __future__ import annotations

import dataclasses
import pickle
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import torch
from torch import nn

from adatracker_deploy.config.schema import Range, parse
from adatracker_deploy.core.errors import UsageError, line_of
from adatracker_deploy.learning.networks import (
    AdaTrackerConfig,
    ContextEncoder,
    ContextPolicy,
    OfflineEvtPolicy,
)
from adatracker_deploy.policy.base import ActionAxis, ActionSpec
from adatracker_deploy.policy.manifest import MaskSpec, Palette

FORMAT = "adatracker"


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckpointMeta:
    """Metadata of a policy's networks; the fields are those of a bundle's manifest."""

    name: str
    mask: MaskSpec
    action: ActionSpec
    rate_hz: Annotated[float, Range(1, 100)]
    training: str
    licence: str
    search: bool = False


@dataclass(frozen=True, slots=True)
class AdaTracker:
    """AdaTracker's networks, in evaluation mode once loaded."""

    encoder: ContextEncoder | None
    """None in the variant without context."""
    policy: ContextPolicy
    meta: CheckpointMeta


@dataclass(frozen=True, slots=True)
class OfflineEvt:
    """The published policy without context, in evaluation mode once loaded."""

    policy: OfflineEvtPolicy
    meta: CheckpointMeta


Checkpoint = AdaTracker | OfflineEvt

OFFLINE_EVT = CheckpointMeta(
    name="offline_evt",
    mask=MaskSpec(
        size=OfflineEvtPolicy.SIZE,
        channels=3,
        draw_size=160,
        scale=1.0,
        palette=Palette(background=(0, 0, 0), target=(255, 255, 255), person="random", obstacle="random"),
    ),
    action=(ActionAxis(axis="yaw", sign=-1), ActionAxis(axis="forward")),
    rate_hz=10.0,
    training="Offline EVT (Zhong et al., ECCV 2024) as published\nCQL-SAC on offline data of one body.",
    licence="none stated",
)
"""The published Offline-EVT checkpoint holds weights alone; the rest is from its authors' code.

Its rate is open, because their simulator steps without a clock; at 10 Hz a geometric world reproduced the
scores that the AdaTracker paper gives it.
"""

ADATRACKER_MASK = MaskSpec(
    size=64,
    channels=3,
    draw_size=64,
    scale=1 / 255,
    palette=Palette(background=(0, 0, 0), target=(255, 0, 0), person=(0, 255, 0), obstacle=(0, 0, 255)),
)
"""AdaTracker's mask input: one channel per class, 0 or 1, drawn at the networks' size.

So the picture is sampled and not reduced: a pixel belongs to one class, in training and on a robot.
"""


def save_checkpoint(
    path: Path, encoder: ContextEncoder | None, policy: ContextPolicy, meta: CheckpointMeta
) -> None:
    """Write an AdaTracker checkpoint that loads without running code.

    Args:
        path: replaced where it exists; its folder must exist.
        encoder: of the policy's configuration; None where that has no context.
        policy: its configuration is stored.
        meta: must agree with the configuration in the mask's channels, its size and the number of actions.
    """
    torch.save(
        {
            "format": FORMAT,
            "config": dataclasses.asdict(policy.config),
            "meta": dataclasses.asdict(meta),
            "state_dict": _together(encoder, policy).state_dict(),
        },
        path,
    )


def load_checkpoint(path: Path) -> Checkpoint:
    """Read a checkpoint, whichever kind its keys show it to be.

    Raises:
        UsageError: there is no such file, it needs more than tensors and plain values, it is of an unknown
            kind, or its weights do not fit its networks or are not finite.
    """
    loaded = load_values(path)
    if isinstance(loaded, dict) and loaded.get("format") == FORMAT:
        return _adatracker(loaded, path)
    if isinstance(loaded, dict) and "CNN_LSTM.CNN_Simple.conv1.weight" in loaded:
        return _offline_evt(loaded, path)
    raise UsageError(
        f"{path}: neither an AdaTracker checkpoint (a mapping with format: {FORMAT}) nor Offline EVT's state "
        "dict (keys CNN_LSTM.*, actor_local.*)"
    )


def load_mean(paths: Sequence[Path]) -> Checkpoint:
    """Read checkpoints and return one whose weights are the mean of theirs.

    Runs that went on from the same weights end apart, yet their mean is often better than each: Wortsman et
    al., "Model soups" (ICML 2022). The mean of runs that did not is worth nothing.

    Args:
        paths: of AdaTracker checkpoints, at least one; or of any single one.

    Raises:
        UsageError: see `load_checkpoint`; or their networks, masks, actions, rates or licences differ.
    """
    if len(paths) == 1:
        return load_checkpoint(paths[0])
    found = [_adatracker_of(path) for path in paths]
    first = found[0]
    for path, each in zip(paths, found, strict=True):
        same = dataclasses.replace(each.meta, name=first.meta.name, training=first.meta.training)
        if (each.policy.config, same) != (first.policy.config, first.meta):
            raise UsageError(f"{path}: its networks, masks, actions, rate or licence are not {paths[0]}'s")
    weights = [_together(each.encoder, each.policy).state_dict() for each in found]
    mean = {name: torch.stack([each[name] for each in weights]).mean(0) for name in weights[0]}
    _fill(_together(first.encoder, first.policy), mean, paths[0])
    told = "\n".join(dict.fromkeys(each.meta.training for each in found))
    meta = dataclasses.replace(first.meta, training=f"The mean of {len(paths)} runs' weights:\n{told}")
    return dataclasses.replace(first, meta=meta)


_DRIVER = ("memory", "actor")


def with_late(usual: Checkpoint, late: Checkpoint, path: Path) -> AdaTracker:
    """Return a policy that one policy's memory and actor drive, or another's where the body obeys late.

    Args:
        usual: the policy.
        late: the other; what sees and what knows the body must be the first one's, as `td3` leaves them.
        path: of the other, for errors.

    Raises:
        UsageError: they are not AdaTracker's, know no response, have two drivers already, or differ in more.
    """
    if not (isinstance(usual, AdaTracker) and isinstance(late, AdaTracker)):
        raise UsageError(f"{path}: only AdaTracker's networks can have a driver for bodies that obey late")
    if late.policy.config != usual.policy.config or usual.policy.config.second_driver:
        raise UsageError(f"{path}: its networks are not those of the usual driver")
    policy = ContextPolicy(dataclasses.replace(usual.policy.config, second_driver=True)).eval()
    first, second = (_together(each.encoder, each.policy).state_dict() for each in (usual, late))
    weights: dict[str, torch.Tensor] = {}
    for name, value in first.items():
        part, _, rest = name.removeprefix("policy.").partition(".")
        if name.startswith("policy.") and part in _DRIVER:
            weights |= {f"policy.{part}.usual.{rest}": value, f"policy.{part}.late.{rest}": second[name]}
        elif torch.allclose(value, second[name], rtol=0.0, atol=1e-6):  # as after a mean of equals
            weights[name] = value
        else:
            raise UsageError(f"{path}: its {name} is another's: begin its td3 with the usual driver's run")
    _fill(_together(usual.encoder, policy), weights, path)
    told = f"{usual.meta.training}\nBodies that obey late are driven by:\n{late.meta.training}"
    return AdaTracker(usual.encoder, policy, dataclasses.replace(usual.meta, training=told))


def one_driver(policy: ContextPolicy, *, late: bool = False) -> ContextPolicy:
    """Return a policy with one of its two drivers alone, the usual or the `late`; itself if it has one."""
    if not policy.config.second_driver:
        return policy
    alone = ContextPolicy(dataclasses.replace(policy.config, second_driver=False))
    kept, other = (".late.", ".usual.") if late else (".usual.", ".late.")
    weights = ((name.replace(kept, "."), value) for name, value in policy.state_dict().items())
    alone.load_state_dict({name: value for name, value in weights if other not in name})
    return alone.eval()


def _adatracker_of(path: Path) -> AdaTracker:
    found = load_checkpoint(path)
    if not isinstance(found, AdaTracker):
        raise UsageError(f"{path}: only AdaTracker checkpoints have a mean")
    return found


def load_values(path: Path) -> Any:
    """Read a file of tensors and plain values; nothing in it is run.

    Raises:
        UsageError: there is no such file, or it holds something else.
    """
    if not path.is_file():
        raise UsageError(f"{path}: no such checkpoint file")
    try:
        return torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError as error:
        raise UsageError(
            f"{path}: holds more than tensors and plain values, or is not a checkpoint, so it is not loaded; "
            "save the state dict alone"
        ) from error
    except Exception as error:  # its unpickler raises whatever the bytes make it stumble over
        raise UsageError(
            f"{path}: not a checkpoint that torch can read; is the download complete?"
        ) from error


def _adatracker(loaded: dict[str, Any], path: Path) -> AdaTracker:
    for key in ("config", "meta", "state_dict"):
        if not isinstance(loaded.get(key), dict):
            raise UsageError(f"{path}: {key} is missing or no mapping")
    config = parse(AdaTrackerConfig, loaded["config"], where=f"{path}: config")
    meta = parse(CheckpointMeta, loaded["meta"], where=f"{path}: meta")
    looks = (meta.mask.channels, meta.mask.size, len(meta.action))
    if looks != (config.channels, config.size, config.actions):
        raise UsageError(f"{path}: meta and config differ in the mask's channels, its size or the actions")
    encoder, policy = ContextEncoder(config) if config.context else None, ContextPolicy(config)
    _fill(_together(encoder, policy), loaded["state_dict"], path)
    return AdaTracker(encoder, policy, meta)


def _offline_evt(state_dict: dict[str, Any], path: Path) -> OfflineEvt:
    policy = OfflineEvtPolicy()
    _fill(policy, {key: value for key, value in state_dict.items() if not key.startswith("critic")}, path)
    return OfflineEvt(policy, OFFLINE_EVT)


def _together(encoder: ContextEncoder | None, policy: ContextPolicy) -> nn.ModuleDict:
    parts: dict[str, nn.Module] = {} if encoder is None else {"encoder": encoder}
    return nn.ModuleDict(parts | {"policy": policy})


def _fill(module: nn.Module, state_dict: dict[str, Any], path: Path) -> None:
    try:
        module.load_state_dict(state_dict)
    except (RuntimeError, TypeError) as error:
        raise UsageError(f"{path}: the weights do not fit: {line_of(error)}") from error
    if not all(bool(weight.isfinite().all()) for weight in module.parameters()):
        raise UsageError(f"{path}: some weights are not finite: its training diverged; take an earlier one")
    module.eval()
