"""A file that is not what it should be is refused in one sentence: what was found, what was expected."""

from __future__ import annotations

import hashlib

import numpy as np
import onnx
import onnxruntime
import pytest

from adatracker_deploy.errors import PlatformError, UsageError
from adatracker_deploy.perception.models import model_file
from adatracker_deploy.perception.models.catalogue import open_model
from adatracker_deploy.perception.models.model_file import read_model_file
from adatracker_deploy.perception.models.session import Network
from tests.perception.models import graphs
from tests.perception.models.graphs import picture


@pytest.fixture
def yolo(tmp_path):
    """Give a function that writes a YOLO file, changed by one function, and returns its path."""

    def write(change=None, **entries):
        path = tmp_path / "model.onnx"
        model = graphs.yolo_raw(path, metadata=graphs.metadata(**entries))
        if change is not None:
            change(model)
            path.write_bytes(model.SerializeToString())
        return path

    return write


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


def test_a_file_that_ends_early_is_none_or_is_empty(yolo, tmp_path, refusal):
    whole = yolo().read_bytes()
    for content in (whole[: len(whole) // 2], b"", b"not a model"):
        (tmp_path / "model.onnx").write_bytes(content)
        assert "is not an ONNX model" in refusal(tmp_path / "model.onnx")
    assert "no such file; expected an ONNX model" in refusal(tmp_path / "other.onnx")


def test_a_file_above_the_cap(yolo):
    with pytest.raises(UsageError, match="a model may have 1 KiB"):
        read_model_file(yolo(), cap_bytes=1024)


def outside(model, location):
    tensor = next(item for item in model.graph.initializer if item.name == "noise")
    data = tensor.raw_data
    tensor.ClearField("raw_data")
    tensor.data_location = onnx.TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value=location)
    return data


def test_weights_beside_the_file_are_refused_unless_they_are_allowed_and_are_really_beside_it(
    yolo, tmp_path, sidecar, refusal
):
    kept = {}
    path = yolo(lambda model: kept.update(data=outside(model, "weights.bin")))
    assert "keeps 'noise' as external data; export it as one file" in refusal(path)
    sidecar(kind="yolo", external_data=True)
    assert "keeps weights in 'weights.bin', which is no plain file beside it" in refusal(path)
    (tmp_path / "weights.bin").write_bytes(kept["data"])
    model = open_model(path)
    assert model(picture((24, 12, 48, 36))).words == ("person",)
    digests = dict(model.networks[0].file.sha256)
    assert digests["weights.bin"] == hashlib.sha256(kept["data"]).hexdigest()
    path = yolo(lambda model: outside(model, "../weights.bin"))
    assert "keeps weights in '../weights.bin'" in refusal(path)


def test_a_model_in_half_precision_on_a_processor(tmp_path, refusal):
    metadata = {"task": "detect", "names": "{0: 'person'}", "imgsz": "[64, 64]"}
    text = "g (float16[1,3,64,64] images) => (float16[1,5,1] output0) { output0 = Identity(k) }"
    graphs.save(tmp_path / "m.onnx", text, {"k": np.zeros((1, 5, 1), np.float16)}, metadata)
    assert "takes half precision (images [1, 3, 64, 64] float16)" in refusal(tmp_path / "m.onnx")


def constant(path, values, declared="1,5,1"):
    metadata = {"task": "detect", "names": "{0: 'person'}", "imgsz": "[64, 64]"}
    text = f"g (float[1,3,64,64] images) => (float[{declared}] output0) {{ output0 = Identity(k) }}"
    graphs.save(path, text, {"k": np.asarray(values, np.float32).reshape(1, 5, -1)}, metadata)
    return path


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite(tmp_path, refusal, bad):
    path = constant(tmp_path / "m.onnx", [1, 1, 1, 1, bad])
    assert "on a first picture it gave output0 with numbers that are not finite" in refusal(path)


def test_scores_that_are_none(tmp_path, refusal):
    path = constant(tmp_path / "m.onnx", [1, 1, 1, 1, 7])
    assert "on a first picture it gave scores from 7 to 7; expected 0 to 1" in refusal(path)


def test_rubbish_that_comes_later_is_the_robots_trouble_and_never_a_box(tmp_path):
    """The logarithm of what is left to nearly white: finite on the first picture, not on a white block."""
    metadata = {"task": "detect", "names": "{0: 'person'}", "imgsz": "[64, 64]"}
    text = """g (float[1,3,64,64] images) => (float[1,5,1] output0) {
        most = ReduceMax<axes = [1, 2, 3], keepdims = 0>(images)
        rest = Sub(limit, most)
        bad = Log(rest)
        none = Mul(bad, nought)
        scalar = Reshape(none, unit)
        output0 = Add(k, scalar)
    }"""
    constants = {
        "limit": np.float32(0.97),
        "nought": np.float32(0),
        "unit": np.array([1, 1, 1]),
        "k": np.array([32, 32, 9, 9, 0.9], np.float32).reshape(1, 5, 1),
    }
    graphs.save(tmp_path / "m.onnx", text, constants, metadata)
    model = open_model(tmp_path / "m.onnx")
    assert len(model(picture((0, 0, 9, 9), (99, 99, 99)))) == 1
    with pytest.raises(PlatformError, match=r"m\.onnx: gave output0 with numbers that are not finite"):
        model(picture((0, 0, 40, 40)))


def test_a_shape_that_is_not_the_declared_one(tmp_path):
    text = "g (float[1,3,64,64] images) => (float[1,n,m] output0) { output0 = Identity(k) }"
    graphs.save(tmp_path / "m.onnx", text, {"k": np.zeros((1, 5, 2), np.float32)})
    file = read_model_file(tmp_path / "m.onnx")
    network = Network(file)
    wrong = model_file.Tensor("output0", "float32", (1, 5, 3))
    with pytest.raises(PlatformError, match=r"gave output0 \[1, 5, 2\]; it declares output0 \[1, 5, 3\]"):
        network.run({"images": np.zeros((1, 3, 64, 64), np.float32)}, [wrong])
    with pytest.raises(PlatformError, match="fails to run"):
        network.run({"images": np.zeros((1, 3, 9, 9), np.float32)}, list(file.outputs.values()))


def test_a_provider_that_nobody_knows_and_one_that_is_not_here(yolo, refusal):
    path = yolo()
    assert "provider 'gpu' is unknown; known are cpu, cuda, tensorrt" in refusal(path, providers=["gpu"])
    if "CUDAExecutionProvider" not in onnxruntime.get_available_providers():
        sentence = refusal(path, providers=["cuda", "cpu"])
        assert "provider 'cuda' is not in this onnxruntime, which has cpu" in sentence


class Fallen(onnxruntime.InferenceSession):
    """What onnxruntime does where CUDA's libraries are missing: it takes the processor and goes on."""

    def __init__(self, model, options, providers):
        super().__init__(model, options, providers=["CPUExecutionProvider"])


def test_a_fall_back_to_the_processor_is_told_or_refused(yolo, monkeypatch):
    file = read_model_file(yolo())
    assert str(Network(file)).endswith("opset 17 on cpu")
    have = ["CUDAExecutionProvider", "CPUExecutionProvider"]
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: have)
    monkeypatch.setattr(onnxruntime, "InferenceSession", Fallen)
    network = Network(file, ["cuda", "cpu"])
    assert network.provider == "cpu"
    assert str(network).endswith("on cpu (cuda was asked for and is not to be had)")
    with pytest.raises(UsageError, match="cuda is not to be had here, only cpu: mend the driver"):
        Network(file, ["cuda"])


def test_a_size_that_no_one_says(tmp_path, sidecar, refusal):
    model = graphs.rf_detr(tmp_path / "model.onnx")
    for axis in (2, 3):
        model.graph.input[0].type.tensor_type.shape.dim[axis].dim_param = f"side{axis}"
    (tmp_path / "model.onnx").write_bytes(model.SerializeToString())
    assert "write `size: [rows, columns]` in the sidecar" in refusal(tmp_path / "model.onnx")
    sidecar(kind="rf_detr", size=[64, 64])
    assert len(open_model(tmp_path / "model.onnx")(picture((24, 12, 48, 36)))) == 1


def test_the_file_that_was_read_is_known_by_its_digest(yolo):
    path = yolo()
    file = read_model_file(path)
    assert file.sha256 == ((path.name, hashlib.sha256(path.read_bytes()).hexdigest()),)
