"""An ONNX graph while it is made: nodes in order, constants as arrays, shapes of what goes in and out."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper

Array = NDArray[Any]
Shape = tuple[int | str, ...]
"""A name in place of a number is an axis of any length."""

OPSET, IR_VERSION = 17, 8  # old enough for every runtime a robot may have


@dataclass(slots=True)
class OnnxGraph:
    """Each tensor has one name; constants are tensors that no node makes."""

    nodes: list[onnx.NodeProto] = field(default_factory=list)
    constants: dict[str, Array] = field(default_factory=dict)
    inputs: dict[str, Shape] = field(default_factory=dict)
    outputs: dict[str, Shape] = field(default_factory=dict)
    _count: Counter[str] = field(default_factory=Counter)

    def add(self, op: str, inputs: list[str], outputs: int = 1, **attributes: Any) -> list[str]:
        """Append a node; return the names of its outputs, which are made from the operation's."""
        names = [self._fresh(op.lower()) for _ in range(outputs)]
        self.nodes.append(helper.make_node(op, inputs, names, name=names[0], **attributes))
        return names

    def constant(self, array: Array, what: str = "constant") -> str:
        """Add a constant; return its name."""
        name = self._fresh(what)
        self.constants[name] = np.ascontiguousarray(array).reshape(array.shape)
        return name

    def _fresh(self, what: str) -> str:
        name = f"{what}_{self._count[what]}"
        self._count[what] += 1
        return name

    def maker(self, tensor: str) -> onnx.NodeProto | None:
        """Return the node that makes `tensor`; None for inputs and constants."""
        return next((node for node in self.nodes if tensor in node.output), None)

    def users(self, tensor: str) -> list[onnx.NodeProto]:
        """Return the nodes that use `tensor`."""
        return [node for node in self.nodes if tensor in node.input]

    def rename(self, old: str, new: str) -> None:
        """Give a tensor that a node makes another name, everywhere."""
        for node in self.nodes:
            node.input[:] = [new if name == old else name for name in node.input]
            node.output[:] = [new if name == old else name for name in node.output]

    def copy(self) -> OnnxGraph:
        """Return a graph of its own, to be changed while this one stays as it is."""
        nodes = []
        for node in self.nodes:
            nodes.append(onnx.NodeProto())
            nodes[-1].CopyFrom(node)
        return OnnxGraph(
            nodes, dict(self.constants), dict(self.inputs), dict(self.outputs), self._count.copy()
        )

    def without_unused(self) -> OnnxGraph:
        """Return the graph without the nodes and constants that no output needs."""
        needed = set(self.outputs)
        kept: list[onnx.NodeProto] = []
        for node in reversed(self.nodes):
            if needed.intersection(node.output):
                kept.append(node)
                needed.update(node.input)
        constants = {name: array for name, array in self.constants.items() if name in needed}
        return OnnxGraph(kept[::-1], constants, self.inputs, self.outputs, self._count)

    def model(self, name: str) -> onnx.ModelProto:
        """Return the checked model; the same graph gives the same bytes."""

        def described(tensors: dict[str, Shape]) -> list[onnx.ValueInfoProto]:
            return [
                helper.make_tensor_value_info(tensor, onnx.TensorProto.FLOAT, shape)
                for tensor, shape in tensors.items()
            ]

        initializers = [numpy_helper.from_array(array, tensor) for tensor, array in self.constants.items()]
        graph = helper.make_graph(
            self.nodes, name, described(self.inputs), described(self.outputs), initializers
        )
        model = helper.make_model(
            graph,
            opset_imports=[helper.make_opsetid("", OPSET)],
            ir_version=IR_VERSION,
            producer_name="adatracker-deploy",
        )
        onnx.checker.check_model(model, full_check=True)
        return model
