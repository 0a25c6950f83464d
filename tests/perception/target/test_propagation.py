"""A propagator fills the gaps of the detector, and never says who the target is.

The propagator is the adapter of SAM2 on four small graphs that follow a colour; the detector finds saturated
blocks, and misses them when it is told to.
"""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import Frame, MaskClass, TargetState
from adatracker_deploy.perception.models.catalogue import open_model
from adatracker_deploy.perception.roles import Instances, Propagated
from adatracker_deploy.perception.segmenters import open_segmenter
from adatracker_deploy.perception.target.choice import Choice
from adatracker_deploy.perception.target.propagation import box_of, resized
from adatracker_deploy.perception.target_segmenter import TargetSegmenter
from tests.perception.models import graphs, sam2_graphs

pytestmark = pytest.mark.usefixtures("chosen_at_once")

SIDE = 160
RED, BLUE = (255, 0, 0), (0, 0, 255)
WIDTH, HEIGHT, TOP = 40, 80, 40


def scene(red=None, blue=None):
    """A dark picture with people of these colours at these left edges."""
    picture = np.zeros((SIDE, SIDE, 3), np.uint8)
    for left, colour in ((red, RED), (blue, BLUE)):
        if left is not None:
            picture[TOP : TOP + HEIGHT, left : left + WIDTH] = colour
    return picture


class Blocks:
    """Implements `Detector`: people are blocks of one colour; asked for the n-th time, it may miss one."""

    vocabulary = ("person",)

    def __init__(self, misses=(), masks=False):
        self.misses = dict(misses)
        self.masks = masks
        self.asked = 0

    def __call__(self, picture, tall=None):
        missed = self.misses.get(self.asked, ())
        self.asked += 1
        boxes, masks = [], []
        for colour in (RED, BLUE):
            hit = (picture == colour).all(axis=2)
            if colour not in missed and hit.any():
                rows, columns = np.flatnonzero(hit.any(axis=1)), np.flatnonzero(hit.any(axis=0))
                boxes.append((columns[0], rows[0], columns[-1] + 1, rows[-1] + 1))
                masks.append(hit)
        found = np.array(boxes, np.float32).reshape(-1, 4)
        scores = np.linspace(0.9, 0.8, len(boxes), dtype=np.float32)
        return Instances(
            found,
            scores,
            ("person",) * len(boxes),
            np.array(masks, bool).reshape(-1, SIDE, SIDE) if self.masks else None,
        )


class Stubborn:
    """Implements `Propagator`: follows this colour, wherever it is started."""

    def __init__(self, colour):
        self.colour = colour
        self.started = 0

    def start(self, picture, mask):
        self.started += 1

    def step(self, picture):
        return Propagated((picture == self.colour).all(axis=2), 0.9)


def film(pictures, rate_hz=20):
    return [
        Frame(picture, 1_000_000_000 + number * 1_000_000_000 // rate_hz, number)
        for number, picture in enumerate(pictures)
    ]


def watch(pictures, detector, propagator=None, **options):
    segmenter = TargetSegmenter(detector, None, Choice.read("best"), propagator, **options)
    return [segmenter(frame) for frame in film(pictures)]


@pytest.fixture
def sam2_file(tmp_path):
    path = tmp_path / "sam2.yaml"
    path.write_text(yaml.safe_dump(sam2_graphs.write(tmp_path)))
    return path


@pytest.fixture
def sam2(sam2_file):
    return open_model(sam2_file)


@pytest.mark.parametrize("masks", [False, True])
def test_a_target_that_the_detector_misses_for_long_stays_tracked(sam2, masks):
    pictures = [scene(20 * (number // 20), 120) for number in range(60)]
    blind = dict.fromkeys(range(5, 60), (RED,))
    without, with_it = watch(pictures, Blocks(blind, masks)), watch(pictures, Blocks(blind, masks), sam2)
    assert without[-1].target is TargetState.LOST
    assert {seen.target for seen in with_it} == {TargetState.TRACKED}
    for number, seen in enumerate(with_it[1:], 1):
        assert seen.box.cx * SIDE == pytest.approx(20 * (number // 20) + WIDTH / 2)
        truth = (pictures[number] == RED).all(axis=2)
        np.testing.assert_array_equal(seen.mask == MaskClass.TARGET, truth)
        assert (seen.mask == MaskClass.PERSON).any()


def test_where_it_sees_the_target_the_propagators_mask_is_drawn_and_no_head_asked(sam2):
    class Head:
        def __init__(self):
            self.asked = []

        def __call__(self, picture, boxes, size):
            self.asked.append(boxes[:, 0].tolist())
            masks = np.zeros((len(boxes), size, size), bool)
            for mask, (left, top, right, bottom) in zip(masks, boxes.astype(int), strict=True):
                mask[top + 20 : bottom - 20, left:right] = True
            return masks

    head = Head()
    segmenter = TargetSegmenter(Blocks(), head, Choice.read("best"), sam2)
    first, second = (segmenter(frame) for frame in film([scene(20, 100)] * 2))
    assert head.asked == [[20, 100], [100]]
    assert (first.mask == MaskClass.TARGET).sum() == WIDTH * (HEIGHT - 40)
    np.testing.assert_array_equal(second.mask == MaskClass.TARGET, (scene(20) == RED).all(axis=2))


def test_the_target_out_of_sight_is_lost_though_somebody_else_is_followed():
    """The neighbour looks different: the lock takes no propagator's word for it."""
    pictures = [scene(40, 80)] * 5 + [scene(None, 60)] * 40
    seen = watch(pictures, Blocks(dict.fromkeys(range(5, 45), (BLUE,))), Stubborn(BLUE))
    assert [each.target for each in seen[5:]].count(TargetState.TRACKED) == 0
    assert seen[-1].target is TargetState.LOST
    assert all(each.box is None for each in seen[11:])


def test_a_propagator_that_follows_somebody_else_is_started_again():
    stubborn = Stubborn(BLUE)
    seen = watch([scene(0, 100)] * 13, Blocks(), stubborn)
    assert all(each.box.cx * SIDE == pytest.approx(WIDTH / 2) for each in seen)
    assert stubborn.started == 1 + 12 // 3
    stubborn = Stubborn(RED)
    watch([scene(0, 100)] * 13, Blocks(), stubborn)
    assert stubborn.started == 1


def test_key_frames_are_those_without_the_target(sam2):
    pictures = [scene(40, 100)] * 10 + [scene(None, 100)] * 4 + [scene(40, 100)] * 10
    detector = Blocks()
    seen = watch(pictures, detector, sam2, key_frames=True)
    assert [each.target for each in seen] == (
        [TargetState.TRACKED] * 10 + [TargetState.COASTING] * 4 + [TargetState.TRACKED] * 10
    )
    assert detector.asked == 2 + 4 + 1  # until lock and propagator have agreed
    assert [bool((each.mask == MaskClass.PERSON).any()) for each in seen] == (
        [True] * 2 + [False] * 8 + [True] * 5 + [False] * 9
    )


def test_with_key_frames_a_propagator_gone_astray_does_not_keep_the_detector_from_being_asked():
    """It insists on the neighbour while the target was hidden and is back: the detector finds the target."""
    pictures = [scene(40, 100)] * 5 + [scene(None, 100)] * 30 + [scene(40, 100)] * 10
    seen = watch(pictures, Blocks(), Stubborn(BLUE), key_frames=True)
    assert seen[-1].target is TargetState.TRACKED
    assert seen[-1].box.cx * SIDE == pytest.approx(40 + WIDTH / 2)
    assert all(each.box is None for each in seen[11:35])


def test_reset_forgets_whom_it_follows(sam2):
    segmenter = TargetSegmenter(Blocks(), None, Choice.read("best"), sam2)
    for frame in film([scene(40, 100)] * 3):
        segmenter(frame)
    segmenter.reset()
    (seen,) = (segmenter(frame) for frame in film([scene(None, 100)]))
    assert seen.box.cx * SIDE == pytest.approx(120)
    (again,) = (segmenter(frame) for frame in film([scene(40, 100)]))
    np.testing.assert_array_equal(again.mask == MaskClass.TARGET, (scene(None, 100) == BLUE).all(axis=2))


@given(
    st.integers(1, 40),
    st.integers(1, 40),
    st.tuples(st.integers(0, 39), st.integers(0, 39), st.integers(1, 40), st.integers(1, 40)),
)
def test_the_box_of_a_mask_is_the_rectangle_in_it(rows, columns, place):
    top, left = place[0] % rows, place[1] % columns
    bottom, right = min(rows, top + place[2]), min(columns, left + place[3])
    mask = np.zeros((rows, columns), bool)
    mask[top:bottom, left:right] = True
    box = box_of(mask, 10 * rows, 4 * columns)
    np.testing.assert_allclose(box, (4 * left, 10 * top, 4 * right, 10 * bottom))


def test_specks_and_nothing():
    mask = np.zeros((40, 40), bool)
    assert box_of(mask, 40, 40) is None
    mask[10:30, 20:28] = mask[2, 2] = mask[39, 39] = True
    np.testing.assert_array_equal(box_of(mask, 40, 40), (20, 10, 28, 30))
    np.testing.assert_array_equal(resized(mask, (40, 40)), mask)
    assert resized(mask, (80, 20)).shape == (80, 20)


def test_a_mask_too_small_to_follow_is_tried_again_with_the_next():
    class Late(Stubborn):
        def start(self, picture, mask):
            super().start(picture, mask)
            if self.started < 3:
                raise UsageError("nothing to follow: the mask is too small for this model")

    late = Late(RED)
    watch([scene(0, 100)] * 6, Blocks(), late)
    assert late.started == 3


def test_by_name_every_part_says_where_it_runs(sam2_file, tmp_path):
    segmenter, line = open_segmenter("embedded", "person", Choice(), propagator=sam2_file)
    assert [part.split()[0] for part in line.split("; ")] == [
        "nanodet_g_int8.onnx",
        "pose_landmark_lite.onnx",
        "selfie_segmentation.onnx",
        *(
            f"{graph}.onnx"
            for graph in ("image_encoder", "memory_attention", "image_decoder", "memory_encoder")
        ),
    ]
    assert segmenter(film([scene(40, 100)])[0]).seq == 0


@pytest.mark.parametrize(
    ("name", "propagator", "words"),
    [
        ("truth", "sam2.yaml", "follows people in pictures, which --segmenter truth does not look at"),
        ("noisy", "sam2.yaml", "which --segmenter noisy does not look at"),
        ("sam2.yaml", None, "does not detect people: give it as --propagator"),
        ("embedded", "yolo.onnx", "does not follow a mask: expected kind sam2"),
        ("embedded", "missing.yaml", "missing.yaml"),
    ],
)
def test_what_cannot_be_composed_is_refused(sam2_file, tmp_path, name, propagator, words):
    graphs.yolo_raw(tmp_path / "yolo.onnx", metadata=graphs.metadata())
    name = str(tmp_path / name) if "." in name else name
    with pytest.raises(UsageError, match=words):
        open_segmenter(
            name,
            "person",
            Choice(),
            propagator=None if propagator is None else tmp_path / propagator,
        )
