"""The same result with less: paddings and sums that a convolution does itself, weights stored as halves."""

from __future__ import annotations

import numpy as np
import onnx
from onnx import helper

from perception_conversion.graph import Array, OnnxGraph


def fold_paddings(graph: OnnxGraph) -> OnnxGraph:
    """Return the graph with paddings done by the convolution or pooling that follows them.

    A convolution pads with 0, a max-pooling with minus infinity: only such a padding, and only of height and
    width, can be folded.
    """
    graph = graph.copy()
    for node in graph.nodes:
        neutral = {"Conv": 0.0, "MaxPool": -np.inf}.get(node.op_type)
        pad = graph.maker(node.input[0]) if neutral is not None else None
        if pad is None or pad.op_type != "Pad":
            continue
        value = graph.constants[pad.input[2]] if len(pad.input) > 2 else np.float32(0)
        before, after = graph.constants[pad.input[1]].reshape(2, -1)
        if value != neutral or before[:2].any() or after[:2].any():
            continue
        _set_pads(node, np.concatenate([before[2:], after[2:]]))
        node.input[0] = pad.input[0]
    return graph.without_unused()


def _set_pads(node: onnx.NodeProto, more: Array) -> None:
    had = next((attribute for attribute in node.attribute if attribute.name == "pads"), None)
    pads = [int(pad) for pad in more]
    if had is not None:
        pads = [old + new for old, new in zip(had.ints, pads, strict=True)]
        node.attribute.remove(had)
    node.attribute.append(helper.make_attribute("pads", pads))


def fold_biases(graph: OnnxGraph) -> OnnxGraph:
    """Return the graph with a constant for each channel, added after a convolution, as its bias."""
    graph = graph.copy()
    for node in list(graph.nodes):
        conv = graph.maker(node.input[0]) if node.op_type == "Add" else None
        if conv is None or conv.op_type not in ("Conv", "ConvTranspose") or len(conv.input) > 2:
            continue
        bias = graph.constants.get(node.input[1])
        if bias is None or bias.shape != (1, bias.size, 1, 1) or len(graph.users(conv.output[0])) > 1:
            continue
        conv.input.append(graph.constant(bias.ravel(), "bias"))
        conv.output[0] = node.output[0]
        graph.nodes.remove(node)
    return graph.without_unused()


def store_halves(graph: OnnxGraph) -> OnnxGraph:
    """Return the graph with the weights stored as float16 where that loses nothing, and cast before use.

    Runtimes cast constants once, while they load; what is computed stays float32.
    """
    graph = graph.copy()
    casts = []
    for name, array in list(graph.constants.items()):
        half = array.astype(np.float16) if array.dtype == np.float32 and array.size > 1 else None
        if half is not None and np.array_equal(half.astype(np.float32), array):
            del graph.constants[name]
            graph.constants[f"{name}_half"] = half
            casts.append(
                helper.make_node(
                    "Cast", [f"{name}_half"], [name], name=f"{name}_cast", to=onnx.TensorProto.FLOAT
                )
            )
    graph.nodes[:0] = casts
    return graph.without_unused()
