"""The exported modules: each network as a single step with explicit state, and its ONNX form.

Shapes are a bundle's: batch 1, C channels, S pixels, A actions, Z context, H hidden, K pairs of F numbers.
"""

from __future__ import annotations

import contextlib
import logging
import warnings
from collections.abc import Iterator

import onnx
import onnxscript.optimizer
import torch
from torch import Tensor, nn

from adatracker_deploy.learning.networks import ContextEncoder, ContextPolicy, OfflineEvtPolicy
from adatracker_deploy.policy.manifest import GraphSpec

OPSET = 18
"""ONNX opset: the oldest that torch's exporter writes, and so the one that most runtimes read."""


class StreamingEncoder(nn.Module):
    """The context encoder, one mask-action pair at a time: a tick costs one pass of the backbone, not K.

    `history` holds each pair's features less those of a blank pair (zero mask, zero action). So the zeros
    that an episode starts with are K blank pairs, and the answer is the window encoder's.
    """

    blank: Tensor

    def __init__(self, encoder: ContextEncoder) -> None:
        super().__init__()
        config = encoder.config
        self.encoder = encoder
        with torch.no_grad():
            blank = encoder.pairs(
                torch.zeros(1, 1, config.channels, config.size, config.size),
                torch.zeros(1, 1, config.actions),
            )
        self.register_buffer("blank", blank)

    def forward(self, mask: Tensor, action: Tensor, history: Tensor) -> tuple[Tensor, Tensor]:
        """Return (z (1, Z), history_next (1, K, F)) of the previous tick's mask and action."""
        newest = self.encoder.pairs(mask.unsqueeze(1), action.unsqueeze(1)) - self.blank
        history_next = torch.cat((history[:, 1:], newest), dim=1)
        return self.encoder.summarise(history_next + self.blank), history_next


class ContextPolicyStep(nn.Module):
    """AdaTracker's policy, one tick, with those of z (1, Z), last_action (1, A) and belief that it uses."""

    def __init__(self, policy: ContextPolicy) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, mask: Tensor, *told: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return (action (1, A) in [-1, 1], h_next, c_next (1, 1, H)).

        Args:
            mask: (1, C, S, S).
            told: [z], [last_action], [belief], h, c.
        """
        config = self.policy.config
        *given, h, c = told
        rest = [part.unsqueeze(1) for part in given]
        z = rest.pop(0) if config.context else None
        last_action = rest.pop(0) if config.last_action else None
        belief = rest.pop(0) if config.belief else None
        mean, _, state = self.policy(mask.unsqueeze(1), z, (h, c), last_action, belief)
        return torch.tanh(mean.squeeze(1)), *state


class OfflineEvtStep(nn.Module):
    """The published Offline-EVT policy, one tick."""

    def __init__(self, policy: OfflineEvtPolicy) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, mask: Tensor, h: Tensor, c: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return (action (1, A) in [-1, 1], h_next, c_next (1, 1, H))."""
        mean, (h_next, c_next) = self.policy(mask.unsqueeze(1), (h, c))
        return torch.tanh(mean.squeeze(1)), h_next, c_next


def to_onnx(module: nn.Module, spec: GraphSpec) -> bytes:
    """Return `module` as one self-contained ONNX file with static shapes and ONNX's own operators.

    Args:
        module: takes the inputs of `spec` by position and returns its outputs in order.
        spec: names and shapes.
    """
    with _quiet():
        program = torch.onnx.export(
            module.eval(),
            tuple(torch.zeros(tensor.shape) for tensor in spec.inputs),
            dynamo=True,
            opset_version=OPSET,
            input_names=[tensor.name for tensor in spec.inputs],
            output_names=[tensor.name for tensor in spec.outputs],
            verbose=False,
        )
    assert program is not None
    # The exporter reorders the LSTM's weights with a dozen operators at run time; all of them fold.
    onnxscript.optimizer.optimize(program.model, input_size_limit=1 << 24, output_size_limit=1 << 24)
    model = program.model_proto
    _forget_origin(model)
    onnx.checker.check_model(model, full_check=True)
    return bytes(model.SerializeToString(deterministic=True))


def _forget_origin(model: onnx.ModelProto) -> None:
    """Drop the source paths and stack traces that the exporter writes beside every node."""
    graph = model.graph
    for part in (
        model,
        graph,
        *graph.node,
        *graph.initializer,
        *graph.value_info,
        *graph.input,
        *graph.output,
    ):
        part.ClearField("doc_string")
        part.ClearField("metadata_props")


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Silence what the exporter says about its own insides: torchvision missing, LSTM buffers, tree specs."""
    log = logging.getLogger("torch.onnx")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        log.setLevel(level)
