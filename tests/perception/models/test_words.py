"""`obstacles` stands for what a model knows of them, unless the model's sidecar says otherwise."""

from __future__ import annotations

import pytest

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.models.catalogue import open_model
from adatracker_deploy.perception.models.coco import COCO80
from adatracker_deploy.perception.models.words import choose
from tests.perception.models import graphs

BLOCK = (24, 12, 48, 36)
NAMES = {0: "person", 1: "Chair", 2: "dog", 3: "traffic cone", 4: "dining  table"}


def words(asked, synonyms=None, names=NAMES):
    return choose(names, asked, synonyms or {}, where="m.onnx")


def test_asked_for_nothing_it_looks_for_everything():
    assert words(()) == NAMES


def test_obstacles_are_those_classes_that_one_may_run_into():
    assert words(["person", "obstacles"]) == {0: "person", 1: "obstacles", 4: "obstacles"}
    of_coco = choose(COCO80, ["obstacles"], {}, where="m.onnx")
    assert {COCO80[index] for index in of_coco} >= {
        "chair",
        "couch",
        "dining table",
        "bicycle",
        "potted plant",
    }
    assert not {COCO80[index] for index in of_coco} & {"person", "dog", "cup", "tie"}


def test_a_word_that_is_asked_for_by_itself_goes_before():
    assert words(["chair", "obstacles"]) == {1: "chair", 4: "obstacles"}


def test_what_a_sidecar_declares_goes_before_the_default():
    assert words(["obstacles"], {"obstacles": ["traffic cone"]}) == {3: "obstacles"}


def test_a_class_of_that_very_name_goes_before_both():
    names = {0: "person", 1: "chair", 2: "obstacles"}
    assert words(["obstacles"], {"obstacles": ["chair"]}, names) == {2: "obstacles"}


def test_case_and_blanks_do_not_matter():
    assert words([" PERSON", "Traffic  Cone"]) == {0: " PERSON", 3: "Traffic  Cone"}


@pytest.mark.parametrize(
    ("asked", "synonyms", "names", "unknown"),
    [
        (["obstacle"], {}, NAMES, "obstacle"),
        (["obstacles"], {}, {0: "person", 1: "dog"}, "obstacles"),  # it knows of none
        (["things"], {"things": ["chair", "zebra"]}, NAMES, "zebra"),
    ],
)
def test_what_stands_for_nothing_is_refused_with_the_known_words(asked, synonyms, names, unknown):
    with pytest.raises(UsageError, match=f"^m.onnx: does not know the word '{unknown}'; it knows .*person"):
        words(asked, synonyms, names)


@pytest.mark.parametrize(
    ("declared", "seen"), [({}, ()), ({"synonyms": {"obstacles": ["dog"]}}, ("obstacles",))]
)
def test_a_sidecars_obstacles_are_what_its_model_finds(tmp_path, sidecar, declared, seen):
    graphs.yolo_raw(tmp_path / "model.onnx", metadata=graphs.metadata())
    sidecar(kind="yolo", **declared)
    found = open_model(tmp_path / "model.onnx", ["person", "obstacles"])(graphs.picture(BLOCK, (0, 0, 255)))
    assert found.words == seen  # a blue block is a dog
