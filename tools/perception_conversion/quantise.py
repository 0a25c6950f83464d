"""Static quantisation to 8 bits: activations by the ranges that calibration shows, weights by channel."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnxruntime.quantization import (
    CalibrationDataReader,
    CalibrationMethod,
    QuantFormat,
    QuantType,
    quantize_static,
)
from onnxruntime.quantization.quant_utils import add_pre_process_metadata

_FLOAT_OPERATIONS = ("Sigmoid", "Split", "Reshape", "Transpose")


class _Reader(CalibrationDataReader):  # type: ignore[misc]
    def __init__(self, name: str, arrays: Iterable[NDArray[np.float32]]) -> None:
        self._name = name
        self._arrays: Iterator[NDArray[np.float32]] = iter(arrays)

    def get_next(self) -> dict[str, Any] | None:
        array = next(self._arrays, None)
        return None if array is None else {self._name: array}


def quantise(model: onnx.ModelProto, inputs: Iterable[NDArray[np.float32]]) -> onnx.ModelProto:
    """Return the model with 8-bit convolutions (UInt8 activations, Int8 weights by channel), heads in float.

    Weights keep to 7 bits: x86 processors that have AVX2 but no VNNI add pairs of 8-bit products in 16 bits,
    which full weights overflow without a sign of it. On an emulated Haswell that doubled the scores' errors;
    with 7 bits its outputs are to the bit those of a processor with VNNI.
    """
    with tempfile.TemporaryDirectory() as folder:
        plain, quantised = Path(folder, "float.onnx"), Path(folder, "int8.onnx")
        inferred = onnx.shape_inference.infer_shapes(model)
        add_pre_process_metadata(inferred)  # no need to advise it: shapes are known, nothing is left to fuse
        onnx.save(inferred, plain)
        quantize_static(
            plain,
            quantised,
            _Reader(model.graph.input[0].name, inputs),
            quant_format=QuantFormat.QDQ,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            per_channel=True,
            reduce_range=True,
            nodes_to_exclude=head_nodes(model),
            calibrate_method=CalibrationMethod.MinMax,
        )
        made = onnx.load(quantised)
    # Nothing of the machine or the tool's own marks: only what tells one model from another.
    made.producer_name, made.producer_version = model.producer_name, model.producer_version
    del made.metadata_props[:], made.graph.value_info[:], made.opset_import[:]
    made.opset_import.extend(model.opset_import)
    onnx.checker.check_model(made, full_check=True)
    return made


def head_nodes(model: onnx.ModelProto) -> list[str]:
    """Return the names of the nodes that stay in float: the heads' last convolutions and what decodes them.

    In 8 bits, scores and distances would share one scale of 256 steps; in float they cost little.
    """
    decoding = [node for node in model.graph.node if node.op_type in _FLOAT_OPERATIONS]
    decoded = {name for node in decoding for name in node.input}
    last = [n for n in model.graph.node if n.op_type == "Conv" and decoded.intersection(n.output)]
    return [node.name for node in (*last, *decoding)]
