"""The target is cut out by the network that knows one person; others, and whom it doubts, by the other."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.models.model_file import read_model_file
from adatracker_deploy.perception.models.pose import SURE, PoseMasks
from adatracker_deploy.perception.models.selfie import SelfieMasks
from adatracker_deploy.perception.weights import shipped
from benchmarks.eyes import mask_iou, rendered
from tests.perception.models import graphs
from tests.perception.models.test_selfie import BRIGHT, SIZE, person, within_a_cell

REDDISH = """
pose (float[1,256,256,3] image) => (float[1,256,256,1] mask, float[1,1] flag) {
    red = Slice(image, b, e, axis)
    lit = Greater(red, level)
    mask = Cast<to = 1>(lit)
    flag = Identity(sure)
}"""
SHAPE, LEFT, RIGHT = (240, 400), (50, 60, 110, 180), (230, 60, 290, 180)


def heads(folder, sure=1.0, text=REDDISH):
    """Return a head that cuts out what is red, as sure as it is told; the other cuts out what is bright."""
    axis = {"b": np.array([0]), "e": np.array([1]), "axis": np.array([3])}
    graphs.save(
        folder / "pose.onnx", text, axis | {"level": np.float32(0.2), "sure": np.array([[sure]], np.float32)}
    )
    graphs.save(folder / "selfie.onnx", BRIGHT, {"level": np.float32(0.5)})
    return PoseMasks(
        read_model_file(folder / "pose.onnx"), SelfieMasks(read_model_file(folder / "selfie.onnx"))
    )


def red(*boxes):
    picture = np.zeros((*SHAPE, 3), np.uint8)
    for left, top, right, bottom in boxes:
        picture[top:bottom, left:right] = (200, 0, 0)  # not bright
    return picture


def test_the_first_is_cut_out_by_the_one_and_the_others_by_the_other(tmp_path):
    boxes = np.array([LEFT, RIGHT], np.float32)
    first, other = heads(tmp_path)(red(LEFT, RIGHT), boxes, SIZE)
    within_a_cell(first, LEFT, SHAPE)
    assert not other.any()


@pytest.mark.parametrize(("sure", "cut_out"), [(SURE + 0.01, True), (SURE - 0.01, False)])
def test_whom_the_network_doubts_the_other_cuts_out(tmp_path, sure, cut_out):
    (mask,) = heads(tmp_path, sure)(red(LEFT), np.array([LEFT], np.float32), SIZE)
    assert mask.any() == cut_out
    bright = person(SHAPE, LEFT)
    (mask,) = heads(tmp_path, sure)(bright, np.array([LEFT], np.float32), SIZE)
    within_a_cell(mask, LEFT, SHAPE)


@pytest.mark.parametrize("sure", [0.3, 0.97])
def test_whether_a_box_is_a_persons_is_the_networks_word_unless_it_marks_nobody_in_it(tmp_path, sure):
    """The square crop around somebody slender shows who stands beside."""
    head, beside = heads(tmp_path, sure), np.array(LEFT, np.float32) + np.array([70, 0] * 2, np.float32)
    assert head.person_in(red(LEFT), np.array(LEFT, np.float32)) == pytest.approx(sure)
    assert head.person_in(red(LEFT), beside) == 0.0


def test_nobody_has_no_mask(tmp_path):
    assert heads(tmp_path)(red(), np.empty((0, 4), np.float32), SIZE).shape == (0, SIZE, SIZE)


def test_a_network_that_does_not_say_how_sure_it_is_is_refused(tmp_path):
    with pytest.raises(UsageError, match="has no output 'flag'"):
        heads(tmp_path, text=REDDISH.replace("flag", "score"))


def test_the_shipped_networks_cut_rendered_people_out_and_the_pose_landmarks_finer(measured):
    selfie = SelfieMasks(shipped("selfie_segmentation.onnx"))
    found = {"selfie": selfie, "pose": PoseMasks(shipped("pose_landmark_lite.onnx"), selfie)}
    ious = {name: [] for name in found}
    for shown in itertools.islice(rendered(seed=8), 10):
        for name, head in found.items():
            ious[name].append(mask_iou(head, shown, shown.box))
    means = {name: float(np.mean(values)) for name, values in ious.items()}
    measured(f"mask IoU of ten rendered people: selfie {means['selfie']:.3f}, pose {means['pose']:.3f}")
    assert means["pose"] > 0.88
    assert means["pose"] > means["selfie"]
