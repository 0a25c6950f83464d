"""The models that are shipped are those of the index, and find people."""

from __future__ import annotations

import hashlib
from importlib import resources
from pathlib import Path

import cv2
import numpy as np
import onnxruntime
import pytest
import yaml
from hatchling.builders.wheel import WheelBuilder

from adatracker_deploy.perception.capture import Capture
from perception_conversion.calibration import nanodet_input

ROOT = Path(__file__).parents[2]
FOLDER = Path(str(resources.files("adatracker_deploy.perception.weights")))
INDEX = yaml.safe_load((FOLDER / "models.yaml").read_text())["models"]
FILES = {name: (model, entry) for model in INDEX.values() for name, entry in model["files"].items()}
SHARED = ROOT.parent / "shared" / "data"
needs_shared = pytest.mark.skipif(
    not SHARED.is_dir(), reason="needs ../shared/data, which is not part of the project"
)


def session(path: Path) -> onnxruntime.InferenceSession:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])


def run(model: onnxruntime.InferenceSession, array) -> dict:
    names = [output.name for output in model.get_outputs()]
    return dict(zip(names, model.run(names, {"image": array}), strict=True))


@pytest.mark.parametrize("name", FILES)
def test_a_file_is_the_one_of_the_index(name):
    content = (FOLDER / name).read_bytes()
    entry = FILES[name][1]
    assert (len(content), hashlib.sha256(content).hexdigest()) == (entry["bytes"], entry["sha256"])


def test_every_model_is_in_the_index_and_in_the_notice():
    assert {path.name for path in FOLDER.glob("*.onnx")} == set(FILES)
    notice = (FOLDER / "NOTICE").read_text()
    for name, (model, _) in FILES.items():
        assert name in notice
        assert model["licence"] == "Apache-2.0"


def test_models_their_index_and_their_licences_are_in_the_wheel():
    included = {file.distribution_path for file in WheelBuilder(str(ROOT)).recurse_included_files()}
    kept = (*FILES, "models.yaml", "NOTICE", "LICENSE-MIT", "LICENSE-Apache-2.0")
    assert {f"adatracker_deploy/perception/weights/{name}" for name in kept} <= included


@pytest.mark.parametrize("name", FILES)
def test_inputs_and_outputs_are_those_of_the_index(name):
    model = session(FOLDER / name)
    for side, tensors in (("inputs", model.get_inputs()), ("outputs", model.get_outputs())):
        found = {
            tensor.name: {"dtype": tensor.type.replace("tensor(float)", "float32"), "shape": tensor.shape}
            for tensor in tensors
        }
        assert found == FILES[name][0][side]


@pytest.mark.parametrize("name", INDEX["nanodet_g"]["files"])
@pytest.mark.parametrize("size", [(320, 416), (32, 64)])
def test_nanodet_takes_any_multiple_of_32_and_gives_each_stride_its_cells(name, size):
    outputs = run(session(FOLDER / name), np.zeros((1, 3, *size), np.float32))
    for stride in (8, 16, 32):
        cells = size[0] // stride * (size[1] // stride)
        assert outputs[f"cls{stride}"].shape == (1, cells, 80)
        assert outputs[f"reg{stride}"].shape == (1, cells, 44)


def pictures(every: int):
    """Yield every so many pictures (BGR) of PETS09-S2L1, with their numbers."""
    capture = Capture(str(SHARED / "video" / "vtest.avi"))
    for index in range(795):
        assert capture.grab()
        if index % every == 0:
            yield index + 1, capture.rgb()[:, :, ::-1]


def people(outputs: dict, width: int, least: float):
    """Return the boxes and scores of persons, decoded as the index says, after non-maximum suppression."""
    boxes, scores = [], []
    for stride in (8, 16, 32):
        score = outputs[f"cls{stride}"][0, :, 0]
        (cells,) = np.nonzero(score >= least)
        logits = outputs[f"reg{stride}"][0, cells].reshape(-1, 4, 11).astype(float)
        share = np.exp(logits - logits.max(axis=2, keepdims=True))
        sides = share @ np.arange(11) / share.sum(axis=2) * stride
        row, column = np.divmod(cells, width // stride)
        centre = np.stack([column + 0.5, row + 0.5], axis=1) * stride
        boxes.append(np.hstack([centre - sides[:, :2], centre + sides[:, 2:]]))
        scores.append(score[cells])
    boxes, scores = np.concatenate(boxes), np.concatenate(scores)
    order = list(np.argsort(-scores, kind="stable"))
    kept = []
    while order:
        kept.append(order.pop(0))
        order = [other for other in order if overlap(boxes[kept[-1]], boxes[other]) <= 0.6]
    return boxes[kept], scores[kept]


def overlap(a, b) -> float:
    inside = np.clip(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0, None).prod()
    return inside / ((a[2:] - a[:2]).prod() + (b[2:] - b[:2]).prod() - inside)


def found_right(boxes, truth) -> int:
    """Return the number of true positives: boxes matched, best first, to a true box with an IoU >= 0.5."""
    left, right = list(truth), 0
    for box in boxes:
        overlaps = [overlap(box, other) for other in left]
        if overlaps and max(overlaps) >= 0.5:
            left.pop(int(np.argmax(overlaps)))
            right += 1
    return right


@needs_shared
@pytest.mark.parametrize("name", INDEX["nanodet_g"]["files"])
def test_nanodet_finds_nine_of_ten_people_and_few_that_are_not_there(name, measured):
    rows = np.loadtxt(SHARED / "boxes" / "mot15-PETS09-S2L1" / "gt" / "gt.txt", delimiter=",")
    model = session(FOLDER / name)
    right = given = true = 0
    for number, picture in pictures(every=15):
        boxes, _ = people(run(model, nanodet_input(picture, 416)), 416, least=0.48)
        boxes = np.clip(boxes * 768 / 416, 0, [768, 576, 768, 576])
        truth = rows[rows[:, 0] == number, 2:6]
        truth[:, 2:] += truth[:, :2]
        right, given, true = right + found_right(boxes, truth), given + len(boxes), true + len(truth)
    measured(f"{name}: recall {right / true:.3f}, precision {right / given:.3f} (PETS09-S2L1, IoU 0.5)")
    assert right / true > 0.87
    assert right / given > 0.90


@needs_shared
def test_eight_bits_give_the_scores_of_the_float_model():
    large, small = (session(FOLDER / f"nanodet_g_{kind}.onnx") for kind in ("fp32", "int8"))
    differences = []
    for _, picture in pictures(every=100):
        array = nanodet_input(picture, 416)
        a, b = run(large, array), run(small, array)
        for stride in (8, 16, 32):
            first, second = a[f"cls{stride}"], b[f"cls{stride}"]
            differences.append(np.abs(first - second)[np.maximum(first, second) > 0.3])
    assert np.concatenate(differences).mean() < 0.02


@needs_shared
def test_the_selfie_model_gives_the_masks_of_a_conversion_by_other_means():
    ours = session(FOLDER / "selfie_segmentation.onnx")
    theirs = session(SHARED / "perception" / "selfie_segmentation.onnx")
    largest = 0.0
    for _, picture in pictures(every=100):
        crop = cv2.resize(picture[100:356, 250:450], (256, 256))[..., ::-1]
        array = crop[None].astype(np.float32) / 255
        (reference,) = theirs.run(None, {theirs.get_inputs()[0].name: array})
        np.testing.assert_allclose(run(ours, array)["mask"], reference, atol=1e-4)
        largest = max(largest, reference.max())
    assert largest > 0.9
