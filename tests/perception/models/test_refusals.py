"""A file that is not what it should be is refused in one sentence: what was found, what was expected."""

from __future__ import annotations

import hashlib

import onnx
import pytest

from adatracker_deploy.perception.models.catalogue import open_model
from tests.perception.models import graphs


def output(model, place):
    return model.graph.output[place].type.tensor_type


def wrong_rank(model):
    del output(model, 0).shape.dim[2]


def wrong_dtype(model):
    output(model, 0).elem_type = onnx.TensorProto.INT64


def another_name(model):
    model.graph.output[0].name = "boxes"


def one_input_more(model):
    model.graph.input.append(onnx.helper.make_tensor_value_info("extra", onnx.TensorProto.FLOAT, [1]))


def no_prototypes(model):
    del model.graph.output[1]


def custom_operator(model):
    model.graph.node[0].domain = "com.example"


def loops(model):
    model.graph.node[0].op_type = "Scan"


def old_opset(model):
    model.opset_import[0].version = 9


def two_classes(model):
    output(model, 0).shape.dim[1].dim_value = 38


def odd_size(model):
    model.graph.input[0].type.tensor_type.shape.dim[2].dim_value = 48


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (wrong_rank, "output: expected output0 [1, any, any] float32/float16; found output0 [1, 39] float32"),
        (wrong_dtype, "found output0 [1, 39, 2] int64"),
        (another_name, "has no output 'output0'; it has boxes [1, 39, 2] float32, output1"),
        (one_input_more, "wants the input extra [1] float32, which nobody feeds; known are picture"),
        (no_prototypes, "is made for the task 'segment' but has no output of prototypes"),
        (custom_operator, "uses the custom operator com.example::ReduceMax"),
        (loops, "holds a loop (Scan), which may never end"),
        (old_opset, "uses opset [9]; expected one from 11 to 26"),
        (two_classes, "3 class names for 2 classes that the graph scores"),
        (odd_size, "rows and columns [48, 64] are no multiples of the stride 32"),
    ],
)
def test_a_graph_of_another_signature(yolo, refusal, change, reason):
    assert reason in refusal(yolo(change))


@pytest.mark.parametrize(
    ("entries", "reason"),
    [
        ({"task": "pose"}, "is made for the task 'pose'; expected detect or segment"),
        ({"names": "__import__('os')"}, "metadata: names: cannot be read"),
        ({"names": "{'a': 1}"}, "metadata: names: expected a number and a name for each class"),
        ({"imgsz": "'big'"}, "metadata: imgsz: expected rows and columns, got 'big'"),
        ({"end2end": True}, "its metadata promise [1, n, 38]; found output0 [1, 39, 2]"),
    ],
)
def test_metadata_that_are_wrong_or_say_otherwise_than_the_graph(yolo, refusal, entries, reason):
    assert reason in refusal(yolo(**entries))


@pytest.mark.parametrize(
    ("keys", "reason"),
    [
        ({"kind": "yolov8"}, "kind: expected one of 'yolo', 'rf_detr', 'grounding_dino', 'sam2', got str"),
        ({"kind": "yolo", "resise": "stretch"}, "unknown key 'resise'; did you mean 'resize'?"),
        ({"resize": "stretch"}, "missing key 'kind'"),
        ({"kind": "yolo", "std": [0, 1, 1]}, "std: expected three numbers above 0"),
        ({"kind": "yolo", "names": ["person"]}, "1 class names for 3 classes"),
        ({"kind": "yolo", "names": {7: "person"}}, "1 class names for 3 classes"),
        ({"kind": "yolo", "names": {"a": "person"}}, "names: expected a class's number, got 'a'"),
        ({"kind": "yolo", "names": "coco91"}, "80 class names for 3 classes"),
        (
            {"kind": "yolo", "size": [32, 64]},
            "size is [32, 64], but the picture input is images [1, 3, 64, 64]",
        ),
        ({"kind": "yolo", "layout": "nhwc"}, "layout is nhwc, but the picture input is images"),
        (
            {"kind": "yolo", "tensors": {"box": "output0"}},
            "tensors: unknown name 'box'; known are picture, inst",
        ),
        ({"kind": "yolo", "synonyms": {"thing": ["zebra"]}}, "does not know the word 'zebra'"),
    ],
)
def test_a_sidecar_that_is_wrong(yolo, sidecar, refusal, keys, reason):
    path = yolo()
    sidecar(**keys)
    assert reason in refusal(path, ["thing"] if "synonyms" in keys else [])


def test_a_file_that_is_not_the_pinned_one_is_refused(yolo, sidecar, refusal):
    path = yolo()
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    sidecar(kind="yolo", sha256={path.name: digest.upper()})
    open_model(path)
    sidecar(kind="yolo", sha256={path.name: digest[::-1]})
    assert f"SHA-256 is {digest}, but the sidecar's sha256 says {digest[::-1]}" in refusal(path)
    sidecar(kind="yolo", sha256={"another.onnx": digest})
    assert "sha256 says none" in refusal(path)


def test_a_sidecar_that_is_no_yaml(yolo, tmp_path, refusal):
    path = yolo()
    (tmp_path / "model.yaml").write_text("kind: [")
    assert "model.yaml: not valid YAML" in refusal(path)


def test_an_unknown_word_with_the_known_ones(yolo, refusal):
    assert "does not know the word 'human'; it knows person, chair, dog" in refusal(yolo(), ["human"])


def test_of_many_known_words_twenty_are_listed(tmp_path, refusal):
    graphs.rf_detr(tmp_path / "m.onnx")
    sentence = refusal(tmp_path / "m.onnx", ["human"])
    assert "person, bicycle, car" in sentence
    assert sentence.endswith(" and 60 more")


def test_a_file_of_no_known_family_is_described(tmp_path, refusal):
    graphs.save(tmp_path / "odd.onnx", "g (float[1,3,8,8] a) => (float[1,3,8,8] b) { b = Relu(a) }")
    sentence = refusal(tmp_path / "odd.onnx")
    assert "inputs a [1, 3, 8, 8] float32; outputs b [1, 3, 8, 8] float32" in sentence
    assert "write odd.yaml beside it, beginning with `kind:`" in sentence
