"""Each family finds the block where it is, in the picture's own px, by its word and with its mask."""

from __future__ import annotations

import numpy as np
import pytest

from adatracker_deploy.perception.models.catalogue import open_model
from tests.perception.models import graphs
from tests.perception.models.graphs import picture

BLOCK = (24, 12, 48, 36)  # of 96 x 48; letterboxed into 64 x 64: gain 2/3, 16 px above: (16, 24, 32, 40)


def mask_of(block, cells, size=(48, 96)):
    """The block at a mask's resolution; only for blocks that fall on whole cells."""
    mask = np.zeros(cells, bool)
    x, y = cells[1] / size[1], cells[0] / size[0]
    mask[round(block[1] * y) : round(block[3] * y), round(block[0] * x) : round(block[2] * x)] = True
    return mask


def block_found(found, word, block=BLOCK, within_px=0.0):
    assert found.words == (word,)
    np.testing.assert_allclose(found.boxes, [block], atol=within_px)


@pytest.mark.parametrize("make", [graphs.yolo_raw, graphs.yolo_finished])
def test_yolo_with_masks_speaks_for_itself_and_needs_no_sidecar(tmp_path, make):
    finished = make is graphs.yolo_finished
    make(tmp_path / "any_name.onnx", metadata=graphs.metadata(end2end=finished))
    found = open_model(tmp_path / "any_name.onnx")(picture(BLOCK))
    block_found(found, "person", within_px=1e-4)
    assert found.scores[0] == pytest.approx(0.9)
    assert found.masks.shape == (1, 8, 16)  # the picture's part of the 16 x 16 prototypes
    np.testing.assert_array_equal(found.masks[0], mask_of(BLOCK, (8, 16)))


@pytest.mark.parametrize("make", [graphs.yolo_raw, graphs.yolo_finished])
def test_yolo_without_masks_gives_boxes_alone(tmp_path, make):
    finished = make is graphs.yolo_finished
    made = graphs.metadata("detect", args={"nms": True} if finished else {"nms": None})
    make(tmp_path / "m.onnx", masks=False, metadata=made)
    found = open_model(tmp_path / "m.onnx", ["person"])(picture(BLOCK))
    block_found(found, "person", within_px=1e-4)
    assert found.masks is None


def test_a_stretched_picture_comes_back_stretched(tmp_path, sidecar):
    graphs.yolo_raw(tmp_path / "model.onnx", metadata=graphs.metadata())
    sidecar(kind="yolo", resize="stretch")
    block = (48, 32, 96, 96)  # of 192 x 128; stretched to (16, 16, 32, 48)
    found = open_model(tmp_path / "model.yaml")(picture(block, size=(128, 192)))
    block_found(found, "person", block, within_px=1e-4)
    np.testing.assert_array_equal(found.masks[0], mask_of(block, (16, 16), (128, 192)))


def test_a_picture_in_the_corner_comes_back_from_the_corner(tmp_path, sidecar):
    graphs.yolo_raw(tmp_path / "model.onnx", metadata=graphs.metadata())
    sidecar(kind="yolo", resize="letterbox_corner")
    block_found(open_model(tmp_path / "model.onnx")(picture(BLOCK)), "person", within_px=1e-4)


@pytest.mark.parametrize(
    ("colour", "order", "word"),
    [((255, 0, 0), "rgb", "person"), ((0, 0, 255), "rgb", "dog"), ((255, 0, 0), "bgr", "dog")],
)
def test_the_order_of_colours_is_the_declared_one(tmp_path, sidecar, colour, order, word):
    graphs.yolo_raw(tmp_path / "model.onnx", metadata=graphs.metadata())
    sidecar(kind="yolo", colour=order)
    assert open_model(tmp_path / "model.onnx")(picture(BLOCK, colour)).words == (word,)


def test_nothing_is_found_where_nothing_is(tmp_path):
    graphs.yolo_raw(tmp_path / "m.onnx", metadata=graphs.metadata())
    found = open_model(tmp_path / "m.onnx")(np.zeros((48, 96, 3), np.uint8))
    assert len(found) == 0
    assert found.boxes.shape == (0, 4)
    assert found.masks.shape == (0, 8, 16)


def test_only_what_is_asked_for_is_found_and_by_the_word_that_was_asked(tmp_path, sidecar):
    graphs.yolo_raw(tmp_path / "model.onnx", metadata=graphs.metadata())
    sidecar(kind="yolo", synonyms={"obstacle": ["chair", "dog"]})
    model = open_model(tmp_path / "model.onnx", ["Person", "obstacle"])
    assert model.vocabulary == ("Person", "obstacle")
    assert model(picture(BLOCK, (0, 0, 255))).words == ("obstacle",)
    assert open_model(tmp_path / "model.onnx", ["chair"])(picture(BLOCK)).words == ()


def test_a_yolo_without_metadata_is_told_its_names(tmp_path, sidecar):
    graphs.yolo_finished(tmp_path / "model.onnx", index=2.0)
    sidecar(kind="yolo", names=["person", "chair", "dog"])
    assert open_model(tmp_path / "model.onnx")(picture(BLOCK)).words == ("dog",)


def test_rf_detr_is_known_by_its_outputs_and_by_cocos_numbers(tmp_path):
    graphs.rf_detr(tmp_path / "m.onnx")
    found = open_model(tmp_path / "m.onnx", ["person"])(picture(BLOCK))
    block_found(found, "person", within_px=1e-3)
    np.testing.assert_array_equal(found.masks[0], mask_of(BLOCK, (16, 16)))


def test_rf_detr_without_masks_and_with_classes_of_its_own(tmp_path, sidecar):
    graphs.rf_detr(tmp_path / "model.onnx", masks=False, classes=4, index=2)
    sidecar(kind="rf_detr", names={1: "person", 2: "robot"})
    found = open_model(tmp_path / "model.onnx", ["robot"])(picture(BLOCK))
    block_found(found, "robot", within_px=1e-3)
    assert found.masks is None


def test_rf_detr_masks_that_went_through_a_sigmoid_must_be_declared(tmp_path, sidecar, refusal):
    model = graphs.rf_detr(tmp_path / "model.onnx", contrast=0.9, below=-0.05)
    empty = next(item for item in model.graph.initializer if item.name == "empty")
    empty.CopyFrom(graphs.numpy_helper.from_array(np.full((1, 1, 16, 16), 0.01, np.float32), "empty"))
    (tmp_path / "model.onnx").write_bytes(model.SerializeToString())
    assert "write `masks: probabilities` in the sidecar" in refusal(tmp_path / "model.onnx")
    sidecar(kind="rf_detr", masks="probabilities")
    found = open_model(tmp_path / "model.onnx")(picture(BLOCK))
    np.testing.assert_array_equal(found.masks[0], mask_of(BLOCK, (16, 16)))


VOCABULARY = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", ".", "a", "person", "obstacle", "back", "##pack"]


@pytest.mark.parametrize("hf", [False, True])
def test_grounding_dino_finds_the_word_whose_tokens_it_scores(tmp_path, sidecar, hf):
    (tmp_path / "vocab.txt").write_text("\n".join(VOCABULARY))
    graphs.grounding_dino(tmp_path / "model.onnx", VOCABULARY.index("person"), hf=hf)
    sidecar(kind="grounding_dino", vocabulary="vocab.txt")
    model = open_model(tmp_path / "model.onnx", ["backpack", "a person"])
    assert model.vocabulary == ("backpack", "a person")
    found = model(picture(BLOCK))
    block_found(found, "a person", within_px=1e-3)
    assert found.scores[0] == pytest.approx(1 / (1 + np.exp(-4)), abs=1e-5)


def test_grounding_dino_has_no_words_of_its_own(tmp_path, sidecar, refusal):
    (tmp_path / "vocab.txt").write_text("\n".join(VOCABULARY))
    graphs.grounding_dino(tmp_path / "model.onnx", 6)
    sidecar(kind="grounding_dino", vocabulary="vocab.txt")
    assert "needs a prompt" in refusal(tmp_path / "model.onnx")
    assert "the word 'zebra' cannot be written" in refusal(tmp_path / "model.onnx", ["zebra"])
    sidecar(kind="grounding_dino")
    assert "under `vocabulary`" in refusal(tmp_path / "model.onnx", ["person"])
