"""NanoDet's grids become boxes where they must, by a network of its true signature that always says the same.

For pictures whose longer side is brought to 64 px: 8 cells of 8 px, 4 of 16 and 2 of 32 along it.
"""

from __future__ import annotations

import numpy as np
import onnx
import pytest
from hypothesis import given
from hypothesis import strategies as st
from onnx import TensorProto, helper, numpy_helper

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.perception.models.coco import COCO80
from adatracker_deploy.perception.models.model_file import read_model_file
from adatracker_deploy.perception.models.nanodet import SIDE as LARGEST
from adatracker_deploy.perception.models.nanodet import STRIDES, NanoDet, suited_side

SIDE = 64
INDEX = {name: index for index, name in COCO80.items()}


def distances(left, top, right, bottom):
    """The four distributions over 0 to 10 whose means are these distances, in strides."""
    logits = np.full((4, 11), -30, np.float32)
    for row, value in zip(logits, (left, top, right, bottom), strict=True):
        low = int(value)
        row[low] = np.log(max(1e-9, 1 - (value - low)))
        if value > low:
            row[low + 1] = np.log(value - low)
    return logits.ravel()


def network(path, found, size=(32, 64), change=None):
    """Write a network that finds (stride, row, column, word, score, distances) whatever it sees.

    Args:
        path: where to.
        found: what it finds.
        size: rows and columns of its input.
        change: a function of the outputs, {name: array}.
    """
    heads = {}
    for stride in (8, 16, 32):
        cells = size[0] // stride * (size[1] // stride)
        heads[f"cls{stride}"] = np.full((1, cells, 80), 0.01, np.float32)
        heads[f"reg{stride}"] = np.zeros((1, cells, 44), np.float32)
    for stride, row, column, word, score, sides in found:
        cell = row * (size[1] // stride) + column
        heads[f"cls{stride}"][0, cell, INDEX[word]] = score
        heads[f"reg{stride}"][0, cell] = distances(*sides)
    heads = (change or (lambda outputs: outputs))(heads)
    return write(
        path,
        [
            helper.make_node("Constant", [], [name], value=numpy_helper.from_array(v))
            for name, v in heads.items()
        ],
        [
            helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, None, v.shape[2]])
            for name, v in heads.items()
        ],
    )


def write(path, nodes, outputs, image="image"):
    given = helper.make_tensor_value_info(image, TensorProto.FLOAT, [1, 3, "H", "W"])
    graph = helper.make_graph(nodes, "nanodet", [given], outputs)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString())
    return read_model_file(path)


def detector(tmp_path, found, words=(), size=(32, 64), change=None, **options):
    return NanoDet(network(tmp_path / "n.onnx", found, size, change), words, side=SIDE, **options)


def blank(rows, columns):
    return np.zeros((rows, columns, 3), np.uint8)


PERSON = (8, 1, 3, "person", 0.8, (1.5, 1, 2.5, 2))
"""Centre (28, 12), 12 px to the left, 8 up, 20 to the right, 16 down: (16, 4, 48, 28) of the input."""


@pytest.mark.parametrize(
    ("rows", "columns", "box"),
    [
        (32, 64, (16, 4, 48, 28)),
        (320, 640, (160, 40, 480, 280)),
        (48, 96, (24, 6, 72, 42)),
        (60, 128, (32, 8, 96, 56)),  # letterboxed: 2 of the input's 32 rows show nothing
        (40, 128, (32, 8, 96, 40)),  # and here 12, so that the box ends with the picture
    ],
)
def test_a_cell_and_its_distances_are_a_box_in_the_pictures_own_pixels(tmp_path, rows, columns, box):
    found = detector(tmp_path, [PERSON])(blank(rows, columns))
    np.testing.assert_allclose(found.boxes, [box], atol=0.02)
    assert found.words == ("person",)
    assert found.scores[0] == pytest.approx(0.8)
    assert found.masks is None


@pytest.mark.parametrize(("rows", "columns"), [(128, 64), (640, 200)])
def test_a_tall_picture_lies_in_a_tall_input(tmp_path, rows, columns):
    found = detector(tmp_path, [(8, 5, 1, "person", 0.8, (1, 2, 1, 2))], size=(64, 32))(blank(rows, columns))
    gain = 64 / rows  # centre (12, 44), 8 px aside, 16 up and down: (4, 28, 20, 60)
    np.testing.assert_allclose(found.boxes, [np.array((4, 28, min(20, columns * gain), 60)) / gain], atol=0.1)


@pytest.mark.parametrize(
    ("stride", "row", "column", "box"),
    [(8, 3, 7, (52, 20, 64, 32)), (16, 1, 0, (0, 8, 24, 32)), (32, 0, 1, (16, 0, 64, 32))],
)
def test_each_grid_has_its_own_stride_and_boxes_end_at_the_picture(tmp_path, stride, row, column, box):
    found = detector(tmp_path, [(stride, row, column, "person", 0.7, (1, 1, 1, 1))])(blank(32, 64))
    np.testing.assert_allclose(found.boxes, [box], atol=0.02)


def test_the_mean_of_a_broad_distribution_is_its_distance(tmp_path):
    def broad(heads):
        heads["reg16"][0, 1] = 0  # all equal: 5 strides, to every side
        return heads

    found = detector(tmp_path, [(16, 0, 1, "person", 0.7, (1, 1, 1, 1))], change=broad)(blank(32, 64))
    np.testing.assert_allclose(found.boxes, [(0, 0, 64, 32)], atol=0.02)


def test_large_logits_do_not_overflow(tmp_path):
    def loud(heads):
        heads["reg8"] = heads["reg8"] * 1e6
        return heads

    found = detector(tmp_path, [(8, 1, 3, "person", 0.8, (1, 1, 2, 2))], change=loud)(blank(32, 64))
    np.testing.assert_allclose(found.boxes, [(20, 4, 44, 28)], atol=0.02)


def test_the_best_come_first_and_twins_of_one_class_are_one(tmp_path):
    everything = [
        PERSON,
        (8, 1, 4, "person", 0.9, (2.5, 1, 1.5, 2)),  # the very same box from the next cell
        (8, 1, 2, "chair", 0.85, (0.5, 1, 3.5, 2)),  # and again, as a chair
        (8, 0, 7, "person", 0.34, (1, 1, 1, 1)),  # unsure
        (8, 3, 0, "dog", 0.4, (0.5, 0.5, 0.5, 0.5)),
    ]
    found = detector(tmp_path, everything)(blank(32, 64))
    assert found.words == ("person", "chair", "dog")
    assert found.scores == pytest.approx([0.9, 0.85, 0.4])


def test_only_what_is_asked_for_is_found_by_the_word_that_was_asked(tmp_path):
    everything = [PERSON, (8, 3, 6, "chair", 0.7, (1, 1, 1, 1)), (8, 3, 0, "dog", 0.6, (0.5, 1, 0.5, 0))]
    model = detector(tmp_path, everything, ["person", "obstacles"])
    assert model.vocabulary == ("person", "obstacles")
    assert model(blank(32, 64)).words == ("person", "obstacles")  # a dog is none
    assert detector(tmp_path, everything, ["Dog"])(blank(32, 64)).words == ("Dog",)
    assert len(detector(tmp_path, everything)(blank(32, 64))) == 3
    assert len(detector(tmp_path, everything).vocabulary) == 80


def test_where_nothing_is_there_is_nothing(tmp_path):
    found = detector(tmp_path, [])(blank(32, 64))
    assert (len(found), found.boxes.shape, found.scores.shape) == (0, (0, 4), (0,))


@pytest.mark.parametrize(
    ("channel", "mean", "std"), [(2, 103.53, 57.375), (1, 116.28, 57.12), (0, 123.675, 58.395)]
)
def test_the_picture_comes_as_blue_green_red_in_imagenets_scale(tmp_path, channel, mean, std):
    """The only score is a third of the brightest value of one channel of the input."""
    place = 2 - channel
    constants = {"third": np.float32(1 / 3), "begin": np.array([place]), "end": np.array([place + 1])}
    constants |= {"axis": np.array([1]), "nought": np.zeros((1, 2, 79), np.float32)}
    constants |= {f"reg{s}": np.zeros((1, n, 44), np.float32) for s, n in ((8, 32), (16, 8), (32, 2))}
    constants |= {f"cls{s}": np.zeros((1, n, 80), np.float32) for s, n in ((8, 32), (16, 8))}
    constants["twice"] = np.array([1, 2, 1])
    nodes = [
        helper.make_node("Constant", [], [n], value=numpy_helper.from_array(np.asarray(v)))
        for n, v in constants.items()
    ]
    nodes += [
        helper.make_node("Slice", ["image", "begin", "end", "axis"], ["one"]),
        helper.make_node("ReduceMax", ["one"], ["top4"], axes=[3], keepdims=0),
        helper.make_node("ReduceMax", ["top4"], ["top"], axes=[2], keepdims=1),
        helper.make_node("Mul", ["top", "third"], ["score1"]),
        helper.make_node("Expand", ["score1", "twice"], ["scores"]),
        helper.make_node("Concat", ["scores", "nought"], ["cls32"], axis=2),
    ]
    outputs = [
        helper.make_tensor_value_info(f"{head}{s}", TensorProto.FLOAT, [1, None, width])
        for s in (8, 16, 32)
        for head, width in (("cls", 80), ("reg", 44))
    ]
    file = write(tmp_path / "n.onnx", nodes, outputs)
    picture = np.full((32, 64, 3), (124, 117, 104), np.uint8)  # about 0 in every channel
    picture[8:16, 8:16, channel] = 250
    found = NanoDet(file, ["person"], side=SIDE)(picture)
    assert found.scores.max() == pytest.approx((250 - mean) / std / 3, abs=1e-4)


def test_an_unknown_word_is_refused_with_the_known_ones(tmp_path):
    with pytest.raises(UsageError, match="does not know the word 'unicorn'; it knows person, bicycle, car"):
        detector(tmp_path, [], ["person", "unicorn"])


@pytest.mark.parametrize("side", [0, -32, 16, 100, 417])
def test_a_side_that_the_strides_do_not_divide_is_refused(tmp_path, side):
    with pytest.raises(UsageError, match=f"side {side}: expected a multiple of 32"):
        NanoDet(network(tmp_path / "n.onnx", []), side=side)


def without(name):
    return lambda heads: {key: value for key, value in heads.items() if key != name}


def narrower(name):
    return lambda heads: {key: value[:, :, :-1] if key == name else value for key, value in heads.items()}


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (without("cls16"), "has no output 'cls16'"),
        (without("reg32"), "has no output 'reg32'"),
        (narrower("cls8"), r"expected cls8 \[1, any, 80\].*found cls8 \[1, any, 79\]"),
        (narrower("reg8"), r"expected reg8 \[1, any, 44\].*found reg8 \[1, any, 43\]"),
    ],
)
def test_another_network_is_refused_before_anything_runs(tmp_path, change, reason):
    with pytest.raises(UsageError, match=reason) as refused:
        detector(tmp_path, [], change=change)
    assert len(str(refused.value).splitlines()) == 1


def filled(name, value):
    def change(heads):
        heads[name][0, 0, 0] = value
        return heads

    return change


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (filled("cls8", np.nan), "n.onnx: gave cls8 with numbers that are not finite"),
        (filled("reg32", np.inf), "n.onnx: gave reg32 with numbers that are not finite"),
        (filled("cls16", 7.0), "n.onnx: gave scores from 7 to 7; expected 0 to 1"),
    ],
)
def test_numbers_that_are_none_end_it_with_a_sentence(tmp_path, change, reason):
    with pytest.raises(PlatformError, match=reason):
        detector(tmp_path, [], change=change)(blank(32, 64))


@pytest.mark.parametrize("head", ["cls8", "reg8"])
def test_grids_of_another_size_than_the_pictures_are_refused(tmp_path, head):
    def cut(heads):
        heads[head] = heads[head][:, :-5]
        return heads

    with pytest.raises(PlatformError, match=f"gave {head} for [0-9]+ cells; an input of 32 x 64 has 32"):
        detector(tmp_path, [PERSON], change=cut)(blank(32, 64))


@given(st.floats(0.01, 1.0))
def test_a_height_that_the_network_is_weak_at_is_scaled_to_another(tall):
    side = suited_side(tall)
    assert side % STRIDES[-1] == 0
    assert STRIDES[-1] < side <= LARGEST
    assert tall * side <= 115 or 185 <= tall * side <= 245


@pytest.mark.parametrize(("tall", "side"), [(0.1, 416), (0.25, 416), (0.35, 320), (0.5, 416), (1.0, 224)])
def test_the_largest_side_that_suits_is_taken(tall, side):
    assert suited_side(tall) == side
