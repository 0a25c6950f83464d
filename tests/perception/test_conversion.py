"""TensorFlow.js graphs come out of the conversion as ONNX graphs that compute the same."""

from __future__ import annotations

import hashlib
import io
import tarfile
from collections import Counter

import cv2
import numpy as np
import onnxruntime
import pytest
from tiny_tfjs import TinyModel

from adatracker_deploy.core.errors import UsageError
from perception_conversion.calibration import calibration_inputs, nanodet_input, videos_in
from perception_conversion.catalogue import NANODET, VOCABULARY
from perception_conversion.conversion import freed
from perception_conversion.fold import fold_biases, fold_paddings, store_halves
from perception_conversion.package import members
from perception_conversion.quantise import head_nodes, quantise
from perception_conversion.tfjs import read
from perception_conversion.translate import translate
from perception_conversion.value import window

ONE = [1, 1, 1, 1]


def drawn(*shape: int, seed: int = 0):
    return np.random.default_rng(seed).integers(-8, 8, shape).astype(np.float32) / 4


def translated(tiny: TinyModel, output: str = "out"):
    return translate(read(*tiny.files()), {"in": "image"}, {output: "result"})


def run(graph, array):
    options = onnxruntime.SessionOptions()
    # As it is written: the runtime's own folding gives a pooling a padding of zeros, which is another thing.
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
    model = graph.model("tiny").SerializeToString()
    session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    return session.run(["result"], {"image": array})[0]


def operations(graph):
    return Counter(node.op_type for node in graph.nodes)


def convolved(picture, kernel, stride=1):
    """The definition: a window of (H, W, C) slides over the picture (H, W, C) without padding."""
    height, width = kernel.shape[:2]
    rows = range(0, picture.shape[0] - height + 1, stride)
    columns = range(0, picture.shape[1] - width + 1, stride)
    return np.array(
        [[np.tensordot(picture[y : y + height, x : x + width], kernel, 3) for x in columns] for y in rows]
    )


def a_padded_convolution(value: float | None = None, axis: int = 2):
    """As NanoDet has them: NCHW outside, transposed before and after, a padding and a bias of its own."""
    tiny = TinyModel()
    pads = np.zeros((4, 2), np.int32)
    pads[axis] = 1, 2
    last = tiny.input("in", 1, 3, 6, 8)
    tiny.constant("pads", pads)
    if value is None:
        last = tiny.add("Pad", "padded", last, "pads")
    else:
        last = tiny.add("PadV2", "padded", last, "pads", tiny.constant("value", np.float32(value)))
    last = tiny.add("Transpose", "nhwc", last, tiny.constant("to_nhwc", np.int32([0, 2, 3, 1])))
    channels = 6 if axis == 1 else 3
    kernel = tiny.constant("kernel", drawn(3, 3, channels, 4), half=True)
    last = tiny.add("Conv2D", "conv", last, kernel, strides=[1, 2, 2, 1], padding="VALID", dilations=ONE)
    last = tiny.add("Add", "sum", last, tiny.constant("bias", drawn(4, seed=1), half=True))
    last = tiny.add("Transpose", "nchw", last, tiny.constant("to_nchw", np.int32([0, 3, 1, 2])))
    tiny.add("LeakyRelu", "out", last, alpha=0.5)
    return tiny


def by_definition(array, value=0.0):
    padded = np.pad(array[0].transpose(1, 2, 0), ((1, 2), (0, 0), (0, 0)), constant_values=value)
    result = convolved(padded, drawn(3, 3, 3, 4), 2) + drawn(4, seed=1)
    return np.where(result < 0, result / 2, result).transpose(2, 0, 1)[None]


def test_transpositions_around_a_convolution_vanish_and_its_padding_and_bias_become_its_own():
    graph = fold_biases(fold_paddings(translated(a_padded_convolution())))
    assert operations(graph) == {"Conv": 1, "LeakyRelu": 1}
    array = drawn(1, 3, 6, 8, seed=2)
    np.testing.assert_allclose(run(graph, array), by_definition(array), atol=1e-5)


def test_folding_leaves_the_graph_that_it_was_given_as_it_was():
    graph = translated(a_padded_convolution())
    before = graph.model("tiny").SerializeToString()
    for fold in (fold_paddings, fold_biases, store_halves):
        fold(graph)
    assert graph.model("tiny").SerializeToString() == before


def test_a_padding_with_something_else_than_zero_stays():
    graph = fold_paddings(translated(a_padded_convolution(value=1.0)))
    assert operations(graph)["Pad"] == 1
    array = drawn(1, 3, 6, 8, seed=2)
    np.testing.assert_allclose(run(graph, array), by_definition(array, 1.0), atol=1e-5)


def test_a_padding_of_channels_stays():
    assert operations(fold_paddings(translated(a_padded_convolution(axis=1))))["Pad"] == 1


@pytest.mark.parametrize(("value", "paddings"), [(-np.inf, 0), (0.0, 1)])
def test_a_pooling_takes_over_a_padding_only_with_minus_infinity(value, paddings):
    tiny = TinyModel()
    tiny.input("in", 1, 1, 4, 4)
    tiny.constant("pads", np.int32([[0, 0], [0, 0], [1, 1], [1, 1]]))
    tiny.add("PadV2", "padded", "in", "pads", tiny.constant("value", np.float32(value)))
    tiny.add("Transpose", "nhwc", "padded", tiny.constant("to_nhwc", np.int32([0, 2, 3, 1])))
    tiny.add("MaxPool", "out", "nhwc", ksize=[1, 3, 3, 1], strides=[1, 2, 2, 1], padding="VALID")
    graph = fold_paddings(translated(tiny))
    assert operations(graph)["Pad"] == paddings
    below = np.full((1, 1, 4, 4), -5, np.float32)  # so that a padding of zero is seen at the edges
    result = run(graph, below)[0, :, :, 0]
    assert result.tolist() == ([[-5, -5], [-5, -5]] if paddings == 0 else [[0, 0], [0, -5]])


@pytest.mark.parametrize(
    ("slide", "padding", "pads", "result"),
    [
        ((256, 3, 2), "SAME", [0, 1], 128),  # an even size: all of it at the end
        ((5, 3, 2), "SAME", [1, 1], 3),
        ((8, 3, 1), "SAME", [1, 1], 8),
        ((8, 1, 2), "SAME", [0, 0], 4),
        ((8, 3, 2), "VALID", [0, 0], 3),
    ],
)
def test_windows_slide_as_tensorflow_says(slide, padding, pads, result):
    size, kernel, stride = slide
    assert window([size], [kernel], [stride], padding) == (pads, (result,))


def test_a_depthwise_convolution_keeps_channels_apart():
    tiny = TinyModel()
    tiny.input("in", 1, 5, 6, 3)
    tiny.constant("kernel", drawn(3, 3, 3, 1))
    tiny.add("DepthwiseConv2dNative", "out", "in", "kernel", strides=ONE, padding="VALID", dilations=ONE)
    array = drawn(1, 5, 6, 3, seed=1)
    kernel = drawn(3, 3, 3, 1)
    wanted = np.concatenate(
        [convolved(array[0, :, :, [c]].transpose(1, 2, 0), kernel[:, :, [c]]) for c in range(3)], axis=2
    )
    np.testing.assert_allclose(run(translated(tiny), array)[0], wanted, atol=1e-5)


@pytest.mark.parametrize(
    ("fused", "bounds"),
    [(["BiasAdd"], None), (["BiasAdd", "Relu"], (0, None)), (["BiasAdd", "Relu6"], (0, 6))],
)
def test_a_convolution_has_the_bias_and_the_activation_that_the_exporter_put_into_it(fused, bounds):
    tiny = TinyModel()
    tiny.input("in", -1, 5, 6, 3)  # any number of pictures: one
    tiny.constant("kernel", drawn(3, 3, 3, 4))
    tiny.constant("bias", drawn(4, seed=1))
    tiny.add(
        "_FusedConv2D",
        "out",
        "in",
        "kernel",
        "bias",
        strides=ONE,
        padding="VALID",
        dilations=ONE,
        fused_ops=fused,
    )
    graph = fold_biases(translated(tiny))
    assert graph.inputs == {"image": (1, 5, 6, 3)}
    array = 4 * drawn(1, 5, 6, 3, seed=2)
    wanted = convolved(array[0], drawn(3, 3, 3, 4)) + drawn(4, seed=1)
    if bounds:
        wanted = wanted.clip(*bounds)
    np.testing.assert_allclose(run(graph, array)[0], wanted, atol=1e-4)


def test_a_transposed_convolution_is_the_adjoint_of_the_convolution():
    def model(op: str, shape, *inputs: str):
        tiny = TinyModel()
        tiny.input("in", *shape)
        tiny.constant("sizes", np.int32([1, 8, 8, 2]))
        tiny.constant("kernel", drawn(3, 3, 2, 5))
        tiny.add(op, "out", *inputs, strides=[1, 2, 2, 1], padding="SAME", dilations=ONE)
        return translated(tiny)

    large, small = drawn(1, 8, 8, 2, seed=1), drawn(1, 4, 4, 5, seed=2)
    forth = run(model("Conv2D", large.shape, "in", "kernel"), large)
    back = run(model("Conv2DBackpropInput", small.shape, "sizes", "kernel", "in"), small)
    assert np.sum(forth * small) == pytest.approx(np.sum(large * back), abs=1e-3)


def test_what_two_frameworks_order_differently_is_added_multiplied_and_joined_as_tensorflow_sees_it():
    tiny = TinyModel()
    tiny.input("in", 1, 4, 6, 2)
    tiny.constant("kernel", np.eye(2, dtype=np.float32)[None, None])
    tiny.add(
        "Conv2D", "same", "in", "kernel", strides=ONE, padding="SAME", dilations=ONE
    )  # NCHW from here on
    tiny.add("Mul", "scaled", tiny.constant("scale", np.float32([2, 3])), "same")
    tiny.add("AddV2", "sum", "scaled", "in")
    tiny.add("ConcatV2", "joined", "sum", "in", tiny.constant("axis", np.int32(3)))
    tiny.constant("sizes", np.int32([1, 3]))
    tiny.add("SplitV", "parts", "joined", "sizes", "axis")
    tiny.add("Relu6", "out", "parts:1")
    array = drawn(1, 4, 6, 2) * 4
    joined = np.concatenate([array * np.float32([2, 3]) + array, array], axis=3)
    np.testing.assert_allclose(run(translated(tiny), array), joined[..., 1:].clip(0, 6), atol=1e-5)


def test_a_picture_of_any_size_passes_through_resizing_and_reshaping():
    tiny = TinyModel()
    tiny.input("in", 1, 2, 4, 4)
    tiny.add("Transpose", "nhwc", "in", tiny.constant("to_nhwc", np.int32([0, 2, 3, 1])))
    tiny.constant("size", np.int32([8, 8]))
    tiny.add("ResizeBilinear", "large", "nhwc", "size", align_corners=False, half_pixel_centers=True)
    tiny.add("Transpose", "nchw", "large", tiny.constant("to_nchw", np.int32([0, 3, 1, 2])))
    # How a shape is put together by the exporter: constants that only look computed.
    tiny.constant("places", np.zeros((0, 1), np.int32))
    tiny.constant("length", np.int32([3]))
    tiny.constant("nothing", np.zeros(0, np.int32))
    tiny.add("SparseToDense", "zeros", "places", "length", "nothing", tiny.constant("zero", np.int32(0)))
    tiny.add("AddV2", "shape", tiny.constant("wanted", np.int32([1, 2, -1])), "zeros")
    tiny.add("Reshape", "flat", "nchw", "shape")
    tiny.add("Transpose", "last", "flat", tiny.constant("turn", np.int32([0, 2, 1])))
    tiny.add("Identity", "out", "last")
    graph = translated(tiny)
    assert graph.outputs == {"result": (1, 64, 2)}
    graph = freed(graph, {"image": {2: "height", 3: "width"}, "result": {1: "cells"}})
    row = np.broadcast_to(np.float32([0, 4, 8]), (1, 2, 1, 3))
    result = run(graph, np.ascontiguousarray(row))
    assert result[0, :, 0].reshape(2, 6).tolist() == [[0, 1, 3, 5, 7, 8]] * 2  # half-pixel centres


@pytest.mark.parametrize(
    ("op", "attributes", "complaint"),
    [
        ("Softmax", {}, "odd: the operation Softmax is not translated"),
        ("ResizeBilinear", {"align_corners": True}, "odd: only half-pixel centres"),
        ("Conv2D", {"dilations": [1, 2, 2, 1], "strides": ONE, "padding": "SAME"}, "odd: dilated"),
        ("Conv2D", {"strides": ONE, "padding": "EXPLICIT"}, "padding EXPLICIT"),
        ("_FusedConv2D", {"strides": ONE, "padding": "SAME", "fused_ops": ["BiasAdd", "Elu"]}, "Elu"),
    ],
)
def test_what_is_not_translated_is_refused_by_name(op, attributes, complaint):
    tiny = TinyModel()
    tiny.input("in", 1, 4, 4, 1)
    tiny.add(op, "odd", "in", tiny.constant("kernel", drawn(1, 1, 1, 1)), **attributes)
    with pytest.raises(ValueError, match=complaint):
        translated(tiny, "odd")


def test_weights_stored_as_halves_lose_nothing_and_what_would_lose_stays():
    tiny = TinyModel()
    tiny.input("in", 1, 1, 1, 2)
    tiny.add("Mul", "scaled", "in", tiny.constant("scale", np.float32([0.5, 2]), half=True))
    tiny.add("Add", "out", "scaled", tiny.constant("shift", np.float32([0.1, 0.2])))
    graph = translated(tiny)
    halved = store_halves(graph)
    assert [array.dtype for array in halved.constants.values()] == [np.float32, np.float16]
    array = drawn(1, 1, 1, 2)
    assert np.array_equal(run(halved, array), run(graph, array))


@pytest.mark.parametrize("change", [lambda stored: stored[:-2], lambda stored: stored + b"  "])
def test_weights_that_do_not_fit_the_graph_are_refused(change):
    model, weights = a_padded_convolution().files()
    with pytest.raises(ValueError, match="weights"):
        read(model, change(weights))


def test_weights_quantised_to_integers_are_refused():
    tiny = a_padded_convolution()
    tiny.weights[-1]["quantization"] = {"dtype": "uint8", "scale": 0.1, "min": 0}
    with pytest.raises(ValueError, match="quantised to uint8"):
        read(*tiny.files())


def a_tarball(folder, **files: bytes):
    path = folder / "package.tgz"
    with tarfile.open(path, "w:gz") as archive:
        for name, content in files.items():
            entry = tarfile.TarInfo(f"package/{name}")
            entry.size = len(content)
            archive.addfile(entry, io.BytesIO(content))
    return path, hashlib.sha256(path.read_bytes()).hexdigest()


def test_only_the_package_that_is_pinned_is_read(tmp_path):
    path, digest = a_tarball(tmp_path, weights=b"123")
    assert members(path, "weights", sha256=digest) == {"weights": b"123"}
    with pytest.raises(UsageError, match="SHA-256 is"):
        members(path, "weights")
    with pytest.raises(UsageError, match="has no file other"):
        members(path, "other", sha256=digest)
    with pytest.raises(UsageError, match="No such file"):
        members(tmp_path / "none.tgz", "weights")


def test_heads_stay_in_float_and_quantising_twice_gives_the_same_bytes():
    tiny = TinyModel()
    last = tiny.input("in", 1, 8, 8, 3)
    for name in ("body", "head"):
        kernel = tiny.constant(f"{name}_kernel", drawn(3, 3, 3, 3))
        last = tiny.add("Conv2D", name, last, kernel, strides=ONE, padding="SAME", dilations=ONE)
    tiny.add("Sigmoid", "out", last)
    model = translated(tiny).model("tiny")
    body, head = (node.name for node in model.graph.node if node.op_type == "Conv")
    assert head in head_nodes(model)
    assert body not in head_nodes(model)
    inputs = [drawn(1, 8, 8, 3, seed=seed) for seed in range(3)]
    first, second = (quantise(model, inputs) for _ in range(2))
    assert first.SerializeToString() == second.SerializeToString()
    weights = [i for i in first.graph.initializer if i.name.endswith("_quantized") and len(i.dims) == 4]
    assert len(weights) == 1
    assert np.abs(np.frombuffer(weights[0].raw_data, np.int8)).max() <= 64  # 7 bits


def test_calibration_takes_videos_and_folders_of_them_and_says_where_there_are_none(tmp_path):
    video = tmp_path / "one.avi"
    writer = cv2.VideoWriter(str(video), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter.fourcc(*"MJPG"), 10, (128, 96))
    for _ in range(6):
        writer.write(np.full((96, 128, 3), 100, np.uint8))
    writer.release()
    assert videos_in([tmp_path]) == videos_in([video]) == [video]
    inputs = list(calibration_inputs([video], 4))
    assert [array.shape for array in inputs] == [(1, 3, 320, 416)] * 2 + [(1, 3, 256, 320)] * 2
    assert inputs[0].mean() < inputs[1].mean() < inputs[2].mean()  # ever brighter
    with pytest.raises(UsageError, match="no video"):
        videos_in([tmp_path / "none"])
    broken = tmp_path / "broken.avi"
    broken.write_bytes(b"no video")
    with pytest.raises(UsageError, match="no picture"):
        list(calibration_inputs([broken], 2))


def test_nanodet_is_given_blue_first_normalised_and_black_below_the_picture():
    blue = np.zeros((15, 20, 3), np.uint8)
    blue[..., 0] = 255
    array = nanodet_input(blue, 64)[0]
    assert array.shape == (3, 64, 64)
    np.testing.assert_allclose(array[:, 47, 0], [(255 - 103.53) / 57.375, -116.28 / 57.12, -123.675 / 58.395])
    np.testing.assert_allclose(array[:, 48, 0], [-103.53 / 57.375, -116.28 / 57.12, -123.675 / 58.395])


def test_nanodet_has_the_classes_of_coco_and_an_output_for_each_stride():
    assert (len(VOCABULARY), len(set(VOCABULARY)), VOCABULARY[0]) == (80, 80, "person")
    assert sorted(NANODET.outputs.values()) == ["cls16", "cls32", "cls8", "reg16", "reg32", "reg8"]
