"""Graphs and golden vectors are plain, self-contained and shaped as the manifest says, or refused."""

from __future__ import annotations

import io

import numpy as np
import onnx
import pytest
from onnx import helper

from adatracker_deploy.core.errors import UsageError
from tests.policy import tiny
from tests.policy.tampering import refusal, replace_file


def external(model):
    tensor = model.graph.initializer[0]
    tensor.ClearField("raw_data")
    tensor.data_location = onnx.TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="../../secret")


def external_in_a_branch(model):
    hidden = helper.make_tensor("hidden", onnx.TensorProto.FLOAT, [1], [0.0])
    external_value = onnx.TensorProto(name="hidden", data_type=1, dims=[1], data_location=1)
    branches = [
        helper.make_graph([helper.make_node("Constant", [], ["k"], value=value)], "branch", [], [])
        for value in (hidden, external_value)
    ]
    model.graph.node.append(
        helper.make_node("If", ["h"], [], then_branch=branches[0], else_branch=branches[1])
    )


def endless_loop(model):
    """A Loop without a trip count, whose condition stays true."""
    true = helper.make_tensor("true", onnx.TensorProto.BOOL, [], [True])
    body = helper.make_graph(
        [helper.make_node("Constant", [], ["goes_on"], value=true)],
        "body",
        [
            helper.make_tensor_value_info("turn", onnx.TensorProto.INT64, []),
            helper.make_tensor_value_info("went_on", onnx.TensorProto.BOOL, []),
        ],
        [helper.make_tensor_value_info("goes_on", onnx.TensorProto.BOOL, [])],
    )
    model.graph.node.append(helper.make_node("Loop", ["", ""], [], body=body))


def loop_in_a_branch(model):
    endless_loop(model)
    loop = model.graph.node.pop()
    branches = [helper.make_graph([loop], name, [], []) for name in ("then", "else")]
    model.graph.node.append(
        helper.make_node("If", ["h"], [], then_branch=branches[0], else_branch=branches[1])
    )


def custom_operator(model):
    model.graph.node[0].domain = "com.example"


def function(model):
    opset = helper.make_opsetid("", tiny.OPSET)
    node = helper.make_node("Tanh", ["x"], ["y"])
    model.functions.append(helper.make_function("own", "twice", ["x"], ["y"], [node], [opset]))


def another_opset(model):
    model.opset_import[0].version = 17


def another_shape(model):
    model.graph.output[0].type.tensor_type.shape.dim[1].dim_value = 3


def dynamic_batch(model):
    model.graph.input[0].type.tensor_type.shape.dim[0].dim_param = "batch"


def another_dtype(model):
    model.graph.input[0].type.tensor_type.elem_type = onnx.TensorProto.DOUBLE


def another_name(model):
    model.graph.input[0].name = "image"


def one_input_more(model):
    model.graph.input.append(helper.make_tensor_value_info("extra", onnx.TensorProto.FLOAT, [1]))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (external, "keeps 'P' as external data; export it as one file"),
        (external_in_a_branch, "keeps 'hidden' as external data"),
        (custom_operator, "uses the custom operator com.example::Flatten"),
        (endless_loop, "holds a loop (Loop), which may never end"),
        (loop_in_a_branch, "holds a loop (Loop), which may never end"),
        (function, "holds functions of its own (twice); export it inlined"),
        (another_opset, "uses opset [17], but the manifest says 18"),
        (another_shape, "outputs: expected action [1, 2] float32, h_next"),
        (dynamic_batch, "got mask [-1, 3, 8, 8] float32"),
        (another_dtype, "got mask [1, 3, 8, 8] another dtype"),
        (another_name, "got image [1, 3, 8, 8] float32"),
        (one_input_more, "extra [1] float32"),
    ],
)
def test_a_graph_that_is_not_the_manifests_or_reaches_outside_is_refused(tmp_path, change, reason):
    parts = tiny.Parts("none")
    change(parts.policy)
    with pytest.raises(UsageError, match=r"policy\.onnx") as refused:
        parts.write(tmp_path)
    assert reason in str(refused.value)


@pytest.mark.parametrize("content", [b"not a model", b"\xff" * 100])
def test_bytes_that_are_no_model_are_refused(folder, content):
    replace_file(folder, "policy.onnx", content)
    assert "policy.onnx: is not an ONNX model" in refusal(folder)


def packed(**arrays):
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def unzipped(array):
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"PK nonsense", "cannot be read as plain arrays"),
        (
            packed(**tiny.golden() | {"z": np.array([{"a": "pickle"}])}),
            "cannot be read as plain arrays: Object",
        ),
        (unzipped(np.zeros(3, np.float32)), "cannot be read as plain arrays"),
        (packed(**tiny.golden("none")), "expected action [24, 2] float32, mask [24, 3, 8, 8] float32, z"),
        (packed(**tiny.golden() | {"more": np.zeros(1)}), "more [1] float64"),
        (packed(**tiny.golden() | {"action": tiny.golden()["action"].astype(np.float64)}), "[24, 2] float64"),
        (packed(**tiny.golden() | {"z": np.full((24, 3), np.nan, np.float32)}), "that are not finite"),
        (packed(**tiny.golden() | {"more": np.zeros(9 << 20)}), "unpacks to more than 65536 KiB"),
    ],
    ids=["no zip", "pickle", "npy", "no z", "one more", "float64", "nan", "bomb"],
)
def test_golden_vectors_that_are_not_the_plain_arrays_expected_are_refused(folder, content, reason):
    replace_file(folder, "golden.npz", content)
    sentence = refusal(folder)
    assert "golden.npz: " in sentence
    assert reason in sentence
