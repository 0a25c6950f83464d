"""Opening and running a model file: its bytes, weights, device and numbers are checked before any box."""

from __future__ import annotations

import hashlib

import numpy as np
import onnx
import onnxruntime
import pytest

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.perception.models import model_file
from adatracker_deploy.perception.models.catalogue import open_model
from adatracker_deploy.perception.models.model_file import read_model_file
from adatracker_deploy.perception.models.session import Network
from tests.perception.models import graphs
from tests.perception.models.graphs import picture


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
    assert "keeps weights in 'weights.bin', which is not a plain file beside it" in refusal(path)
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
    """The model adds 0 * log(0.97 - brightest pixel): finite on the first picture, NaN on a white block."""
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
    assert "provider 'gpu' is unknown; known are cpu, cuda, tensorrt, coreml" in refusal(
        path, providers=["gpu"]
    )
    if "CUDAExecutionProvider" not in onnxruntime.get_available_providers():
        sentence = refusal(path, providers=["cuda", "cpu"])
        assert "provider 'cuda' is not in this onnxruntime, which has cpu" in sentence


class Fallen(onnxruntime.InferenceSession):
    """Imitates onnxruntime without CUDA's libraries: it falls back to the CPU and goes on."""

    asked: list

    def __init__(self, model, options, providers, provider_options, enable_fallback):
        Fallen.asked = providers
        super().__init__(model, options, providers=["CPUExecutionProvider"])


def test_a_fall_back_to_the_processor_is_told_or_refused(yolo, monkeypatch):
    file = read_model_file(yolo())
    assert str(Network(file)).endswith("opset 17 on cpu")
    have = ["CUDAExecutionProvider", "CPUExecutionProvider"]
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: have)
    monkeypatch.setattr(onnxruntime, "InferenceSession", Fallen)
    network = Network(file, ["cuda", "cpu"])
    assert Fallen.asked == have
    assert network.provider == "cpu"
    assert str(network).endswith("on cpu (cuda was asked for and is unavailable)")
    with pytest.raises(UsageError, match="cuda is not available here, only cpu: repair the driver"):
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
