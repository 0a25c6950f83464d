"""The networks of a bundle, for training to go on from: the export, read backwards.

A bundle has its policy's weights in two ONNX graphs. Where these are AdaTracker's, as `export` writes them,
torch gets the same networks back; the bundle's golden vectors decide whether they are the same.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import Tensor

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.checkpoint import AdaTracker, CheckpointMeta
from adatracker_deploy.learning.networks import AdaTrackerConfig, ContextEncoder, ContextPolicy
from adatracker_deploy.learning.rollout import rollout

if TYPE_CHECKING:
    from adatracker_deploy.policy.bundle import Bundle

_TOLERANCE = 1e-4
"""Largest difference of an answer: a hundred times that between torch and onnxruntime."""


def networks_of(bundle: Bundle) -> AdaTracker:
    """Return a bundle's networks, in evaluation mode.

    Raises:
        UsageError: they are not AdaTracker's, or answer the golden vectors differently.
    """
    refusal = UsageError(
        f"{bundle.folder}: its networks are not AdaTracker's, so training cannot go on from them"
    )
    try:
        found = _rebuilt(bundle)
    except (KeyError, IndexError, RuntimeError, StopIteration, ValueError) as error:
        raise refusal from error
    answers, golden = rollout(found, bundle.golden["mask"]), bundle.golden
    if any(np.abs(answers[name] - golden[name]).max() > _TOLERANCE for name in golden if name in answers):
        raise refusal
    return found


def _rebuilt(bundle: Bundle) -> AdaTracker:
    manifest = bundle.manifest
    policy = _Graph(bundle.policy)
    encoder = _Graph(bundle.encoder) if bundle.encoder else None
    told = {tensor.name for tensor in manifest.policy.inputs}
    two = policy.count("LSTM") == 2
    memories, actors = ([f"{part}.usual", f"{part}.late"] if two else [part] for part in ("memory", "actor"))
    weights = policy.tensors("policy.")
    for index, (memory, actor) in enumerate(zip(memories, actors, strict=True)):
        weights |= policy.lstm(memory, index) | policy.actor(actor)
    config = AdaTrackerConfig(
        channels=manifest.mask.channels,
        size=manifest.mask.size,
        actions=len(manifest.action),
        history=manifest.history,
        front="pooled" if "backbone.mix.bias" in weights else "cnn",
        features=len(weights["backbone.project.bias"]),
        context=manifest.context,
        encoder_hidden=encoder.lstm("lstm")["lstm.weight_hh_l0"].shape[1]
        if encoder
        else AdaTrackerConfig().encoder_hidden,
        hidden=weights[f"{memories[0]}.weight_hh_l0"].shape[1],
        actor=len(weights[f"{actors[0]}.hidden.bias"]),
        last_action="last_action" in told,
        belief="belief" in told,
        response=manifest.response,
        second_driver=two,
    )
    torch_policy = ContextPolicy(config)
    unused = {name: value for name, value in torch_policy.state_dict().items() if ".log_std." in name}
    torch_policy.load_state_dict(weights | unused)  # an exported policy acts by its mean
    torch_encoder = None
    if encoder is not None:
        torch_encoder = ContextEncoder(config)
        torch_encoder.load_state_dict(encoder.tensors("encoder.") | encoder.lstm("lstm"))
        torch_encoder.eval()
    meta = CheckpointMeta(
        name=manifest.name,
        mask=manifest.mask,
        action=manifest.action,
        rate_hz=manifest.rate_hz,
        training=manifest.training,
        licence=manifest.licence,
        search=manifest.search,
    )
    return AdaTracker(torch_encoder, torch_policy.eval(), meta)


class _Graph:
    """One exported graph's weights, under torch's names."""

    def __init__(self, content: bytes) -> None:
        graph = onnx.load_from_string(content).graph
        self._nodes = graph.node
        self._values = {entry.name: numpy_helper.to_array(entry) for entry in graph.initializer}

    def tensors(self, prefix: str) -> dict[str, Tensor]:
        """Return those that the export left under their names, less a prefix that not every export writes."""
        named = {name.removeprefix(prefix): value for name, value in self._values.items() if "." in name}
        return {name: torch.tensor(value) for name, value in named.items()}

    def count(self, kind: str) -> int:
        """Return how many nodes of a kind there are."""
        return sum(node.op_type == kind for node in self._nodes)

    def lstm(self, name: str, index: int = 0) -> dict[str, Tensor]:
        """Return an LSTM's: ONNX has the gates i, o, f, c, torch has i, f, c, o."""
        node = [node for node in self._nodes if node.op_type == "LSTM"][index]
        inner, recurrent, biases = (self._values[entry][0] for entry in node.input[1:4])
        first, second = np.split(biases, 2)
        parts = {"weight_ih_l0": inner, "weight_hh_l0": recurrent, "bias_ih_l0": first, "bias_hh_l0": second}
        return {f"{name}.{key}": torch.tensor(_reordered(value)) for key, value in parts.items()}

    def actor(self, name: str) -> dict[str, Tensor]:
        """Return the weights of an actor's two layers: the exporter wrote them transposed."""
        found = {}
        for layer in (f"{name}.hidden", f"{name}.mean"):
            added = next(node for node in self._nodes if f"policy.{layer}.bias" in node.input)
            product = next(node for node in self._nodes if node.output[0] in added.input)
            found[f"{layer}.weight"] = torch.tensor(self._values[product.input[1]].T.copy())
        return found


def _reordered(
    gates: np.ndarray[tuple[int, ...], np.dtype[np.float32]],
) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    i, o, f, c = np.split(gates, 4)
    return np.concatenate((i, f, c, o))
