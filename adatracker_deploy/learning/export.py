"""Exports a checkpoint to a policy bundle, verified against torch before it is written."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from adatracker_deploy.config.schema import parse
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.checkpoint import (
    AdaTracker,
    Checkpoint,
    CheckpointMeta,
    OfflineEvt,
    load_mean,
    with_late,
)
from adatracker_deploy.learning.graphs import (
    OPSET,
    ContextPolicyStep,
    OfflineEvtStep,
    StreamingEncoder,
    to_onnx,
)
from adatracker_deploy.learning.networks import ContextEncoder
from adatracker_deploy.learning.rollout import rollout, walking_masks
from adatracker_deploy.policy.bundle import Bundle, load_bundle, write_bundle
from adatracker_deploy.policy.golden import GOLDEN_TICKS, Golden
from adatracker_deploy.policy.manifest import FORMAT, GraphSpec, Interface, Manifest, graph_specs
from adatracker_deploy.policy.onnx_policy import OnnxPolicy

EncoderInterface = Literal["streaming", "window"]
_GOLDEN_SEED = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class _Parts:
    """The arguments of `write_bundle`."""

    manifest: Manifest
    encoder: bytes | None
    policy: bytes
    golden: Golden

    def write(self, folder: Path) -> Manifest:
        return write_bundle(
            folder, self.manifest, encoder=self.encoder, policy=self.policy, golden=self.golden
        )


def export_checkpoint(
    path: Path,
    out: Path,
    *,
    others: Sequence[Path] = (),
    late: Sequence[Path] = (),
    interface: EncoderInterface | None = None,
    name: str | None = None,
    rate_hz: float | None = None,
    licence: str | None = None,
    search: bool = False,
    force: bool = False,
) -> Manifest:
    """Write the bundle of a checkpoint, after checking that it loads and gives torch's answers.

    Args:
        path: an AdaTracker or Offline-EVT checkpoint.
        out: the bundle's folder.
        others: further AdaTracker checkpoints; the bundle has the mean of all weights (`load_mean`).
        late: checkpoints whose mean drives bodies that obey late (`with_late`).
        interface: how the encoder is called; streaming unless given, and not to be given without an encoder.
        name: instead of the checkpoint's.
        rate_hz: instead of the checkpoint's.
        licence: instead of the checkpoint's.
        search: it gives way to a search once the target may have left the view; needs a belief.
        force: replace what a folder that is not empty holds of a bundle.

    Returns:
        The manifest as it was written.

    Raises:
        UsageError: one line that says what is wrong; nothing has been written then.
    """
    checkpoint = load_mean([path, *others])
    if late:
        checkpoint = with_late(checkpoint, load_mean(late), late[0])
    if out.exists() and not out.is_dir():
        raise UsageError(f"{out}: is a file; name a folder for the bundle")
    if out.is_dir() and any(out.iterdir()) and not force:
        raise UsageError(f"{out}: is not empty; name another folder, or replace the bundle with --force")
    given = {"name": name, "rate_hz": rate_hz, "licence": licence, "search": search or None}
    overrides = {key: value for key, value in given.items() if value is not None}
    meta = parse(CheckpointMeta, asdict(checkpoint.meta) | overrides, where=str(path))
    if interface is not None and (isinstance(checkpoint, OfflineEvt) or checkpoint.encoder is None):
        raise UsageError(f"{path}: has no context encoder, so no interface {interface!r}; leave that out")
    if meta.search and (isinstance(checkpoint, OfflineEvt) or not checkpoint.policy.config.belief):
        raise UsageError(f"{path}: was trained without a belief, which tells when to search")
    if isinstance(checkpoint, AdaTracker):
        parts = _adatracker(checkpoint, meta, interface or "streaming")
    else:
        parts = _offline_evt(checkpoint, meta)
    with tempfile.TemporaryDirectory() as rehearsal:
        parts.write(Path(rehearsal))
        OnnxPolicy(load_bundle(Path(rehearsal)))
    return parts.write(out)


def largest_difference(bundle: Bundle) -> float:
    """Return max |torch - onnxruntime| over the golden vectors: actions, contexts and beliefs."""
    policy = OnnxPolicy(bundle)
    largest = 0.0
    for tick, mask in enumerate(bundle.golden["mask"]):
        action, z = policy.step(mask)
        for name, got in (("action", action), ("z", z), ("belief", policy.belief)):
            if got is not None:
                largest = max(largest, float(np.abs(got - bundle.golden[name][tick]).max()))
    return largest


def _offline_evt(checkpoint: OfflineEvt, meta: CheckpointMeta) -> _Parts:
    policy = checkpoint.policy
    _, spec = graph_specs("none", mask=meta.mask, actions=policy.ACTIONS, hidden=policy.HIDDEN)
    return _Parts(
        manifest=_manifest(meta, "none", policy=spec),
        encoder=None,
        policy=to_onnx(OfflineEvtStep(policy), spec),
        golden=_golden(checkpoint),
    )


def _adatracker(checkpoint: AdaTracker, meta: CheckpointMeta, interface: EncoderInterface) -> _Parts:
    encoder, config = checkpoint.encoder, checkpoint.policy.config
    called: Interface = interface if encoder is not None else "none"
    encoder_spec, policy_spec = graph_specs(
        called,
        mask=meta.mask,
        actions=config.actions,
        hidden=config.state,
        context=config.context,
        history=config.history,
        features=config.features + config.actions,
        last_action=config.last_action,
        belief=config.belief,
        response=config.response,
    )
    return _Parts(
        manifest=_manifest(
            meta,
            called,
            history=config.history,
            context=config.context,
            response=config.response,
            encoder=encoder_spec,
            policy=policy_spec,
        ),
        encoder=_encoder_graph(encoder, interface, encoder_spec) if encoder and encoder_spec else None,
        policy=to_onnx(ContextPolicyStep(checkpoint.policy), policy_spec),
        golden=_golden(checkpoint),
    )


def _encoder_graph(encoder: ContextEncoder, interface: EncoderInterface, spec: GraphSpec) -> bytes:
    return to_onnx(encoder if interface == "window" else StreamingEncoder(encoder), spec)


def _manifest(
    meta: CheckpointMeta,
    interface: Interface,
    *,
    policy: GraphSpec,
    encoder: GraphSpec | None = None,
    history: int = 0,
    context: int = 0,
    response: bool = False,
) -> Manifest:
    return Manifest(
        format=FORMAT,
        name=meta.name,
        interface=interface,
        opset=OPSET,
        history=history,
        context=context,
        response=response,
        search=meta.search,
        mask=meta.mask,
        action=meta.action,
        rate_hz=meta.rate_hz,
        encoder=encoder,
        policy=policy,
        training=meta.training,
        licence=meta.licence,
    )


def _golden(checkpoint: Checkpoint) -> Golden:
    return rollout(checkpoint, walking_masks(checkpoint.meta.mask, GOLDEN_TICKS, _GOLDEN_SEED))
