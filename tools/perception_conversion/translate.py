"""TensorFlow's graph to ONNX.

TensorFlow keeps pictures as NHWC, ONNX as NCHW. Transposing before and after every convolution would be right
and slow, so a transposition is not written down but remembered: a `Value` is an ONNX tensor and the order in
which TensorFlow sees its axes. Only where the order matters (to reshape, for outputs) a Transpose is written.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perception_conversion.graph import OnnxGraph
from perception_conversion.tfjs import Graph, Node
from perception_conversion.value import NHWC_OF_NCHW, Value, replaced, window

Array = NDArray[Any]


def translate(source: Graph, inputs: Mapping[str, str], outputs: Mapping[str, str]) -> OnnxGraph:
    """Return the graph in ONNX; `inputs` and `outputs` say what TensorFlow's names become.

    Raises:
        ValueError: an operation, or an option of one, that is not translated here.
    """
    return _Translation(source, inputs).run(outputs)


class _Translation:
    def __init__(self, source: Graph, inputs: Mapping[str, str]) -> None:
        self._source = source
        self._inputs = inputs
        self._graph = OnnxGraph()
        self._constants: dict[str, Array] = dict(source.constants)
        self._values: dict[str, Value] = {}

    def run(self, outputs: Mapping[str, str]) -> OnnxGraph:
        for node in self._source.nodes:
            if node.op == "Placeholder":
                self._values[node.name] = self._input(node)
            elif node.op in _FOLDED and all(name in self._constants for name in node.inputs):
                self._constants[node.name] = _FOLDED[node.op](*(self._constants[i] for i in node.inputs))
            elif node.op in _TRANSLATED:
                made = _TRANSLATED[node.op](self, node)
                for index, value in enumerate(made if isinstance(made, list) else [made]):
                    self._values[f"{node.name}:{index}" if index else node.name] = value
            else:
                raise ValueError(f"{node.name}: the operation {node.op} is not translated here")
        for name, readable in outputs.items():
            value = self._ordered(self._values[name])
            self._graph.rename(value.name, readable)
            self._graph.outputs[readable] = value.shape
        return self._graph.without_unused()

    def _input(self, node: Node) -> Value:
        shape = tuple(1 if length == -1 else length for length in node.attributes["shape"])  # one picture
        name = self._inputs[node.name]
        self._graph.inputs[name] = shape
        return Value(name, shape, tuple(range(len(shape))))

    def _ordered(self, value: Value, order: tuple[int, ...] | None = None) -> Value:
        """Return the value with its axes in `order`: transposed, unless it has that order already."""
        order = tuple(range(len(value.shape))) if order is None else order
        if value.order == order:
            return value
        permutation = [value.order[order.index(axis)] for axis in range(len(order))]
        (name,) = self._graph.add("Transpose", [value.name], perm=permutation)
        return Value(name, tuple(value.shape[axis] for axis in permutation), order)

    def _picture(self, name: str) -> Value:
        return self._ordered(self._values[name], NHWC_OF_NCHW)

    def _apply(self, op: str, value: Value, *more: str, **attributes: Any) -> Value:
        """Apply an operation that keeps shape and order."""
        (name,) = self._graph.add(op, [value.name, *more], **attributes)
        return value._replace(name=name)

    # Operations without weights.

    def transpose(self, node: Node) -> Value:
        value = self._values[node.inputs[0]]
        return value._replace(order=tuple(value.order[axis] for axis in self._constants[node.inputs[1]]))

    def identity(self, node: Node) -> Value:
        return self._values[node.inputs[0]]

    def leaky_relu(self, node: Node) -> Value:
        alpha = node.attributes.get("alpha", 0.2)
        return self._apply("LeakyRelu", self._values[node.inputs[0]], alpha=alpha)

    def relu(self, node: Node) -> Value:
        return self._apply("Relu", self._values[node.inputs[0]])

    def relu6(self, node: Node) -> Value:
        return self._clipped(self._values[node.inputs[0]])

    def _clipped(self, value: Value) -> Value:
        bounds = [self._graph.constant(np.array(bound, np.float32)) for bound in (0, 6)]
        return self._apply("Clip", value, *bounds)

    def sigmoid(self, node: Node) -> Value:
        return self._apply("Sigmoid", self._values[node.inputs[0]])

    def add(self, node: Node) -> Value:
        return self._elementwise("Add", node)

    def multiply(self, node: Node) -> Value:
        return self._elementwise("Mul", node)

    def _elementwise(self, op: str, node: Node) -> Value:
        """Translate a sum or product of two: values, or a value and a constant in either place."""
        first, second = sorted(node.inputs, key=lambda name: name in self._constants)
        value = self._values[first]
        if second in self._constants:
            constant = self._constants[second]
            if constant.ndim:  # broadcast as TensorFlow sees it, then put into the order that ONNX has
                whole = constant.reshape((1,) * (len(value.shape) - constant.ndim) + constant.shape)
                constant = whole.transpose(np.argsort(value.order))
            other = Value(self._graph.constant(constant), constant.shape, value.order)
        else:
            other = self._ordered(self._values[second], value.order)
        (name,) = self._graph.add(op, [value.name, other.name])
        return Value(name, np.broadcast_shapes(value.shape, other.shape), value.order)

    def concatenate(self, node: Node) -> Value:
        values = [self._values[name] for name in node.inputs[:-1]]
        order = values[0].order
        axis = order[int(self._constants[node.inputs[-1]])]
        values = [self._ordered(value, order) for value in values]
        (name,) = self._graph.add("Concat", [value.name for value in values], axis=axis)
        return values[0]._replace(
            name=name, shape=replaced(values[0].shape, axis, sum(v.shape[axis] for v in values))
        )

    def split(self, node: Node) -> list[Value]:
        value = self._values[node.inputs[0]]
        sizes = self._constants[node.inputs[1]]
        axis = value.order[int(self._constants[node.inputs[2]])]
        lengths = self._graph.constant(sizes.astype(np.int64))
        names = self._graph.add("Split", [value.name, lengths], outputs=len(sizes), axis=axis)
        return [
            value._replace(name=name, shape=replaced(value.shape, axis, int(size)))
            for name, size in zip(names, sizes, strict=True)
        ]

    def reshape(self, node: Node) -> Value:
        value = self._ordered(self._values[node.inputs[0]])
        wanted = self._constants[node.inputs[1]].astype(np.int64)
        shape = np.empty(value.shape, np.bool_).reshape(wanted).shape
        (name,) = self._graph.add("Reshape", [value.name, self._graph.constant(wanted)])
        return Value(name, shape, tuple(range(len(shape))))

    def pad(self, node: Node) -> Value:
        value = self._values[node.inputs[0]]
        pads = self._constants[node.inputs[1]][np.argsort(value.order)]
        more = [self._graph.constant(pads.T.ravel().astype(np.int64))]
        if len(node.inputs) == 3:
            more.append(self._graph.constant(self._constants[node.inputs[2]]))
        padded = self._apply("Pad", value, *more)
        return padded._replace(
            shape=tuple(int(size + sum(pad)) for size, pad in zip(value.shape, pads, strict=True))
        )

    def resize(self, node: Node) -> Value:
        if node.attributes.get("align_corners") or not node.attributes.get("half_pixel_centers"):
            raise ValueError(f"{node.name}: only half-pixel centres are translated here")
        value = self._picture(node.inputs[0])
        shape = (*value.shape[:2], *(int(size) for size in self._constants[node.inputs[1]]))
        # A scale rather than a size, so that the height and width of the model may become free.
        scales = np.divide(shape, value.shape).astype(np.float32)
        resized = self._apply("Resize", value, "", self._graph.constant(scales), mode="linear")
        return resized._replace(shape=shape)

    # Windows that slide over a picture.

    def convolution(self, node: Node) -> Value:
        weights = self._constants[node.inputs[1]].transpose(3, 2, 0, 1)  # HWIO to OIHW
        return self._convolution(node, weights, groups=1)

    def depthwise_convolution(self, node: Node) -> Value:
        kernel = self._constants[node.inputs[1]]  # height, width, channels, outputs a channel
        weights = kernel.reshape(*kernel.shape[:2], 1, -1).transpose(3, 2, 0, 1)
        return self._convolution(node, weights, groups=kernel.shape[2])

    def _convolution(self, node: Node, weights: Array, groups: int) -> Value:
        if set(node.attributes.get("dilations", [1])) != {1}:
            raise ValueError(f"{node.name}: dilated convolutions are not translated here")
        value = self._picture(node.inputs[0])
        weight = self._graph.constant(weights, "weight")
        kernel = weights.shape[2:]
        return self._slide("Conv", node, value, kernel, weights.shape[0], weight, group=groups)

    def fused_convolution(self, node: Node) -> Value:
        return self._activated(node, self.convolution(node))

    def fused_depthwise_convolution(self, node: Node) -> Value:
        return self._activated(node, self.depthwise_convolution(node))

    def _activated(self, node: Node, value: Value) -> Value:
        """Apply what the exporter has put into a convolution: its bias, and perhaps an activation."""
        fused = node.attributes["fused_ops"]
        if fused not in (["BiasAdd"], ["BiasAdd", "Relu6"], ["BiasAdd", "Relu"]):
            raise ValueError(f"{node.name}: {fused} within a convolution is not translated here")
        bias = self._constants[node.inputs[2]].reshape(1, -1, 1, 1)
        value = self._apply("Add", value, self._graph.constant(bias))
        match fused[1:]:
            case ["Relu6"]:
                return self._clipped(value)
            case ["Relu"]:
                return self._apply("Relu", value)
            case _:
                return value

    def max_pool(self, node: Node) -> Value:
        value = self._picture(node.inputs[0])
        return self._slide("MaxPool", node, value, node.attributes["ksize"][1:3], value.shape[1])

    def average_pool(self, node: Node) -> Value:
        value = self._picture(node.inputs[0])
        kernel = node.attributes["ksize"][1:3]
        return self._slide("AveragePool", node, value, kernel, value.shape[1])

    def _slide(
        self, op: str, node: Node, value: Value, kernel: Any, channels: int, *more: str, **attributes: Any
    ) -> Value:
        strides = node.attributes["strides"][1:3]
        pads, sizes = window(value.shape[2:], kernel, strides, node.attributes["padding"])
        slid = self._apply(
            op, value, *more, kernel_shape=list(kernel), strides=strides, pads=pads, **attributes
        )
        return slid._replace(shape=(value.shape[0], channels, *sizes))

    def transposed_convolution(self, node: Node) -> Value:
        shape = [int(size) for size in self._constants[node.inputs[0]]]  # NHWC, of the result
        weights = self._constants[node.inputs[1]].transpose(3, 2, 0, 1)  # HWOI to IOHW
        value = self._picture(node.inputs[2])
        strides = node.attributes["strides"][1:3]
        kernel = weights.shape[2:]
        pads, sizes = window(shape[1:3], kernel, strides, node.attributes["padding"])
        if sizes != value.shape[2:]:
            raise ValueError(f"{node.name}: a convolution of {shape} would not give {value.seen}")
        weight = self._graph.constant(weights, "weight")
        attributes = {"kernel_shape": list(kernel), "strides": strides, "pads": pads}
        made = self._apply("ConvTranspose", value, weight, **attributes)
        return made._replace(shape=(shape[0], shape[3], *shape[1:3]))


def _sparse_to_dense(indices: Array, shape: Array, values: Array, default: Array) -> Array:
    dense = np.full(shape, default)
    dense[tuple(indices.T)] = values
    return dense


_FOLDED: dict[str, Callable[..., Array]] = {
    "Add": np.add,
    "AddV2": np.add,
    "SparseToDense": _sparse_to_dense,
}
"""Operations on constants that are done now."""

_TRANSLATED: dict[str, Callable[[_Translation, Node], Value | list[Value]]] = {
    "Add": _Translation.add,
    "AddN": _Translation.add,
    "AddV2": _Translation.add,
    "AvgPool": _Translation.average_pool,
    "ConcatV2": _Translation.concatenate,
    "Conv2D": _Translation.convolution,
    "Conv2DBackpropInput": _Translation.transposed_convolution,
    "DepthwiseConv2dNative": _Translation.depthwise_convolution,
    "FusedDepthwiseConv2dNative": _Translation.fused_depthwise_convolution,
    "Identity": _Translation.identity,
    "LeakyRelu": _Translation.leaky_relu,
    "MaxPool": _Translation.max_pool,
    "Mul": _Translation.multiply,
    "Pad": _Translation.pad,
    "PadV2": _Translation.pad,
    "Relu": _Translation.relu,
    "Relu6": _Translation.relu6,
    "Reshape": _Translation.reshape,
    "ResizeBilinear": _Translation.resize,
    "Sigmoid": _Translation.sigmoid,
    "SplitV": _Translation.split,
    "Transpose": _Translation.transpose,
    "_FusedConv2D": _Translation.fused_convolution,
}
