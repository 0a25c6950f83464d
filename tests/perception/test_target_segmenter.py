"""From pictures to observations: what is drawn, who covers whom, whose box it is.

The detector here is a real one for a painted world: it finds each thing by the colour of its pixels.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from adatracker_deploy.core.messages import Frame, MaskClass, TargetState, at_size
from adatracker_deploy.perception.drawing import mask_shape
from adatracker_deploy.perception.roles import Instances
from adatracker_deploy.perception.segmenter import check_observation
from adatracker_deploy.perception.target.choice import Choice
from adatracker_deploy.perception.target.recognition import BRIDGED_S
from adatracker_deploy.perception.target_segmenter import CUT_OUT, SEARCHED, TargetSegmenter

pytestmark = pytest.mark.usefixtures("chosen_at_once")

ROWS, COLUMNS = 240, 400
RED, GREEN, BLUE, PINK = (200, 30, 30), (30, 160, 40), (30, 60, 200), (240, 120, 180)
CHAIR, BOX = (120, 90, 10), (10, 90, 120)
THINGS = {
    RED: ("person", 0.9),
    GREEN: ("person", 0.8),
    BLUE: ("person", 0.7),
    PINK: ("person", 0.6),
    CHAIR: ("chair", 0.75),
    BOX: ("box", 0.4),  # too unsure to be drawn
}
TARGET, PERSON, OBSTACLE = MaskClass.TARGET, MaskClass.PERSON, MaskClass.OBSTACLE


class Colours:
    """Implements `Detector`: one instance of each known colour, boxed by its own pixels."""

    vocabulary = ("person", "chair", "box")

    def __init__(self, masks=False, size=160):
        self.masks, self.size = masks, size

    def __call__(self, picture, tall=None):
        boxes, scores, words, masks = [], [], [], []
        for colour, (word, score) in THINGS.items():
            hit = (picture == colour).all(axis=2)
            if hit.any():
                rows, columns = np.flatnonzero(hit.any(axis=1)), np.flatnonzero(hit.any(axis=0))
                boxes.append((columns[0], rows[0], columns[-1] + 1, rows[-1] + 1))
                scores.append(score)
                words.append(word)
                masks.append(cells(hit, self.size))
        return Instances(
            np.array(boxes, np.float32).reshape(-1, 4),
            np.array(scores, np.float32),
            tuple(words),
            np.array(masks, bool).reshape(-1, self.size, self.size) if self.masks else None,
        )


class Unsure(Colours):
    """Half as sure of everybody."""

    def __call__(self, picture, tall=None):
        found = super().__call__(picture, tall)
        return replace(found, scores=found.scores / 2)


class Word:
    """Implements `Witness`: a person is who has one colour."""

    def __init__(self, colour):
        self.colour = colour

    def person_in(self, picture, box):
        left, top, right, bottom = box.astype(int)
        return float((picture[top:bottom, left:right] == self.colour).all(axis=2).mean() > 0.5)


class CutOut:
    """Implements `MaskHead`: a person is what has a known colour in the middle of the box."""

    def __init__(self):
        self.asked = []

    def __call__(self, picture, boxes, size):
        self.asked.append(len(boxes))
        masks = np.zeros((len(boxes), size, size), bool)
        for mask, (left, top, right, bottom) in zip(masks, boxes.astype(int), strict=True):
            inside = picture[top:bottom, left:right].reshape(-1, 3)
            colour = next(c for c in THINGS if (inside == c).all(axis=1).mean() > 0.4)
            mask[:] = cells((picture == colour).all(axis=2), size)
        return masks


class Blind:
    """Implements `MaskHead`: sees nobody in any box."""

    def __call__(self, picture, boxes, size):
        return np.zeros((len(boxes), size, size), bool)


class Doubtful(Colours):
    """From the sixth picture on it is not sure that red is a person."""

    def __init__(self):
        super().__init__(masks=True)
        self.asked = 0

    def __call__(self, picture, tall=None):
        self.asked += 1
        found = super().__call__(picture, tall)
        if self.asked <= 5:
            return found
        red = (picture[found.boxes[:, 1].astype(int), found.boxes[:, 0].astype(int)] == RED).all(axis=1)
        scores = np.where(red, np.float32(0.25), found.scores)
        best_first = np.argsort(-scores, kind="stable")
        return replace(found, scores=scores).only(best_first)


def cells(hit, size=160):
    return cv2.resize(hit.astype(np.float32), (size, size), interpolation=cv2.INTER_AREA) >= 0.5


def scene(*things):
    """Paint rectangles (colour, left, top, right, bottom), the nearest last."""
    picture = np.full((ROWS, COLUMNS, 3), 128, np.uint8)
    for colour, left, top, right, bottom in things:
        picture[top:bottom, left:right] = colour
    return picture


def film(*pictures, rate_hz=20):
    return [
        Frame(picture, 7_000_000_000 + number * 1_000_000_000 // rate_hz, number + 1)
        for number, picture in enumerate(pictures)
    ]


def watch(frames, segmenter=None):
    segmenter = segmenter or TargetSegmenter(Colours(masks=True), None, Choice.read("largest"))
    seen = []
    for frame in frames:
        seen.append(segmenter(frame))
        check_observation(seen[-1], frame)
    return seen


def look(*things, detector=None, mask_head=None, target="best"):
    (seen,) = watch(
        film(scene(*things)), TargetSegmenter(detector or Colours(), mask_head, Choice.read(target))
    )
    return seen


@pytest.mark.parametrize(("colour", "left"), [(RED, 50), (GREEN, 250)])
def test_of_people_in_doubt_whom_a_witness_sees_becomes_the_target(colour, left):
    picture = scene((RED, 50, 60, 120, 180), (GREEN, 250, 60, 320, 180))
    segmenter = TargetSegmenter(Unsure(), None, Choice.read("largest"), witness=Word(colour))
    seen = watch(film(*[picture] * 3), segmenter)
    assert seen[-1].box.cx * COLUMNS == pytest.approx(left + 35)


def part(*corners):
    """A rectangle in the picture's px, as cells of the mask, which has the picture's aspect."""
    left, top, right, bottom = corners
    hit = np.zeros((ROWS, COLUMNS), bool)
    hit[top:bottom, left:right] = True
    return at_size(cells(hit), 96, 160)


@pytest.mark.parametrize("how", [{"detector": Colours(masks=True)}, {"mask_head": CutOut()}])
def test_the_target_other_people_and_obstacles_are_each_drawn_where_they_are(how):
    things = (RED, 50, 60, 100, 180), (GREEN, 200, 60, 250, 180), (CHAIR, 300, 120, 360, 210)
    seen = look(*things, **how)
    for (_, *corners), value in zip(things, (TARGET, PERSON, OBSTACLE), strict=True):
        np.testing.assert_array_equal(seen.mask == value, part(*corners))
    assert (seen.mask.shape, seen.mask.dtype) == ((96, 160), np.uint8)
    assert (seen.target, seen.confidence) == (TargetState.TRACKED, 1)


def test_the_box_is_in_fractions_of_both_sides():
    box = look((RED, 50, 60, 100, 180)).box
    assert (box.cx, box.cy, box.w, box.h) == pytest.approx((75 / 400, 120 / 240, 50 / 400, 120 / 240))


def test_without_masks_a_person_is_an_ellipse_in_their_box():
    mask = look((RED, 100, 60, 150, 180)).mask == TARGET
    inside = part(100, 60, 150, 180)
    assert not (mask & ~cv2.dilate(inside.astype(np.uint8), np.ones((3, 3))).astype(bool)).any()
    assert mask.sum() == pytest.approx(np.pi / 4 * inside.sum(), rel=0.1)


@pytest.mark.parametrize(("target", "nearer"), [("best", PERSON), ("#2", TARGET)])
def test_who_stands_lower_covers_who_stands_higher_target_or_not(target, nearer):
    seen = look((RED, 50, 40, 110, 160), (GREEN, 90, 60, 150, 200), target=target)
    assert seen.mask[part(95, 100, 105, 140)].tolist().count(nearer) > 0.9 * part(95, 100, 105, 140).sum()


def test_a_second_box_on_the_target_is_never_painted_over_it():
    alone = look((RED, 100, 40, 180, 200))
    twice = look((RED, 100, 40, 180, 200), (GREEN, 115, 120, 165, 206))
    np.testing.assert_array_equal(twice.mask == TARGET, alone.mask == TARGET)


def test_an_obstacle_that_is_only_a_box_never_hides_anybody():
    alone = look((RED, 150, 40, 210, 160))
    behind = look((RED, 150, 40, 210, 160), (CHAIR, 100, 130, 149, 230), (CHAIR, 211, 130, 300, 230))
    np.testing.assert_array_equal(behind.mask == TARGET, alone.mask == TARGET)
    assert (behind.mask == OBSTACLE).sum() > 0.5 * part(100, 130, 300, 230).sum()


def test_an_obstacle_with_a_mask_hides_who_is_behind_it():
    things = (RED, 150, 40, 210, 200), (CHAIR, 100, 130, 300, 230)
    seen = look(*things, detector=Colours(masks=True))
    np.testing.assert_array_equal(seen.mask == TARGET, part(150, 40, 210, 130))
    np.testing.assert_array_equal(seen.mask == OBSTACLE, part(100, 130, 300, 230))


def test_an_unsure_obstacle_is_not_drawn():
    seen = look((RED, 50, 60, 100, 180), (BOX, 200, 60, 300, 180))
    assert not (seen.mask == OBSTACLE).any()


@pytest.mark.parametrize("things", [(), ((CHAIR, 100, 130, 300, 230),)])
def test_where_nobody_is_nobody_is_the_target(things):
    seen = look(*things)
    assert (seen.box, seen.target, seen.confidence) == (None, None, 0)
    assert set(np.unique(seen.mask)) <= {0, OBSTACLE}


def test_people_are_drawn_while_the_one_to_follow_is_not_yet_in_sight():
    seen = look((GREEN, 200, 60, 250, 180), target="0.1,0.5")
    assert (seen.box, seen.target) == (None, None)
    assert (seen.mask == PERSON).any()
    assert not (seen.mask == TARGET).any()


def test_the_mask_head_cuts_out_the_target_and_the_nearest():
    heads = CutOut()
    things = [(c, 20 + 90 * i, 40, 70 + 90 * i, 150 + 20 * i) for i, c in enumerate((RED, GREEN, BLUE, PINK))]
    seen = look(*things, mask_head=heads)
    assert heads.asked == [CUT_OUT]
    np.testing.assert_array_equal(seen.mask == TARGET, part(*things[0][1:]))  # the farthest, but the target
    left_out = part(*things[1][1:])
    assert 0 < (seen.mask[left_out] == PERSON).mean() < 0.9  # an ellipse
    assert (seen.mask[part(*things[3][1:])] == PERSON).all()


def test_whom_the_mask_head_misses_is_an_ellipse():
    seen = look((RED, 20, 180, 70, 240), (GREEN, 150, 40, 200, 190), mask_head=Blind())
    for place, kind in ((part(20, 180, 70, 240), TARGET), (part(150, 40, 200, 190), PERSON)):
        assert 0.6 < (seen.mask[place] == kind).mean() < 0.9


def walk(number):
    """Red walks to the right before green, who stands further off; a chair stands before both."""
    return scene(
        (GREEN, 185, 60, 225, 150),
        (RED, 20 + 6 * number, 60, 70 + 6 * number, 200),
        (CHAIR, 320, 150, 390, 230),
    )


def test_a_walk_is_the_same_every_time_and_the_target_is_always_red():
    first, second = (watch(film(*map(walk, range(45)))) for _ in range(2))
    for number, (a, b) in enumerate(zip(first, second, strict=True)):
        np.testing.assert_array_equal(a.mask, b.mask)
        assert (a.box, a.confidence, a.target, a.seq) == (b.box, b.confidence, b.target, b.seq)
        assert a.box.cx * COLUMNS == pytest.approx(45 + 6 * number)
        assert a.target is TargetState.TRACKED


def test_reset_chooses_anew():
    segmenter = TargetSegmenter(Colours(), None, Choice.read("best"))
    both, green = (
        scene((RED, 50, 60, 100, 180), (GREEN, 200, 60, 250, 180)),
        scene((GREEN, 200, 60, 250, 180)),
    )
    (a, b) = watch(film(both, green), segmenter)
    assert (a.box.cx, a.target) == (75 / 400, TargetState.TRACKED)
    assert b.target is TargetState.COASTING
    segmenter.reset()
    (c,) = watch(film(green), segmenter)
    assert (c.box.cx, c.target) == (225 / 400, TargetState.TRACKED)


def test_out_of_sight_there_is_neither_box_nor_mask_and_back_again_there_is():
    here, empty = scene((RED, 150, 60, 200, 180)), scene()
    seen = watch(film(*[here] * 3, *[empty] * 50, *[here] * 5))
    assert [each.target for each in seen[:22]] == [TargetState.TRACKED] * 3 + [TargetState.COASTING] * 19
    bridged = 3 + round(BRIDGED_S * 20)
    for each in seen[3:bridged]:
        assert each.box.cx == pytest.approx(seen[2].box.cx)
        assert each.confidence == 0
        np.testing.assert_array_equal(each.mask, seen[2].mask)
    for each in seen[bridged:53]:
        assert (each.box, each.confidence, each.mask.max()) == (None, 0, 0)
    assert seen[52].target is TargetState.LOST
    assert [each.target for each in seen[53:]] == [TargetState.LOST] * 2 + [
        TargetState.REACQUIRED,
        TargetState.TRACKED,
        TargetState.TRACKED,
    ]
    assert (seen[-1].mask == TARGET).any()


def test_the_first_person_to_come_is_chosen_though_the_film_began_without_one():
    seen = watch(film(scene(), scene((CHAIR, 0, 0, 50, 50)), scene((GREEN, 200, 60, 250, 180))))
    assert [each.target for each in seen] == [None, None, TargetState.TRACKED]


def test_a_picture_of_one_colour_and_any_shape_is_no_trouble():
    for shape in ((1, 1, 3), (2, 300, 3), (300, 2, 3)):
        seen = watch(film(*[np.full(shape, 200, np.uint8)] * 2))
        assert seen[1].mask.shape == mask_shape(*shape[:2])
        assert max(seen[1].mask.shape) == 160


class Missing:
    """Implements `Detector`: finds a person only if told a height that suits it."""

    vocabulary = ("person",)

    def __init__(self, suits):
        self.suits, self.told = suits, []

    def __call__(self, picture, tall=None):
        self.told.append(tall)
        there = Instances(
            np.array([(50, 60, 100, 180)], np.float32), np.array([0.9], np.float32), ("person",)
        )
        return there if self.suits(tall) else Instances.none()


@pytest.mark.parametrize("suits", [lambda tall: tall is None, lambda tall: tall is not None])
def test_a_target_that_one_scale_misses_is_looked_for_at_another(suits):
    seen = watch(film(*[scene()] * 4), TargetSegmenter(Missing(suits), None))
    assert TargetState.TRACKED in {each.target for each in seen[:2]}


def test_the_detector_is_told_how_tall_the_target_is_while_it_is_in_sight():
    detector = Missing(lambda tall: True)
    watch(film(*[scene()] * 4), TargetSegmenter(detector, None))
    assert detector.told[1:] == [120 / 400] * 3


def test_the_detector_is_told_so_while_single_pictures_miss_the_target_and_all_sizes_when_it_is_lost():
    """It coasts for a second, of 20 pictures."""
    detector = Missing(lambda tall: len(detector.told) not in {6, 7} and len(detector.told) < 12)
    seen = watch(film(*[scene()] * 40), TargetSegmenter(detector, None))
    here = 120 / 400
    assert [each.target for each in seen[5:8]] == [
        TargetState.COASTING,
        TargetState.COASTING,
        TargetState.TRACKED,
    ]
    lost = next(n for n, each in enumerate(seen) if each.target is TargetState.LOST)
    assert set(detector.told[1 : lost + 1]) == {here}
    assert lost >= 30
    assert set(detector.told[lost + 1 :]) == set(SEARCHED)


def test_a_target_that_one_picture_misses_is_drawn_where_it_goes():
    """It walks 6 px a picture; the detector misses it once."""
    pictures = [scene((RED, 20 + 6 * n, 60, 70 + 6 * n, 200)) for n in range(12)]
    pictures[8] = scene()
    seen = watch(film(*pictures))
    assert seen[8].target is TargetState.COASTING
    assert seen[8].box.cx * COLUMNS == pytest.approx(45 + 6 * 8, abs=2)
    there = part(20 + 6 * 8, 60, 70 + 6 * 8, 200)
    drawn = seen[8].mask == TARGET
    assert (drawn & there).sum() / (drawn | there).sum() > 0.85


def doubtful(*pictures):
    return watch(film(*pictures), TargetSegmenter(Doubtful(), None, Choice.read("best"), least_score=0.35))


def test_a_doubtful_box_continues_the_track_of_the_target_alone():
    seen = doubtful(
        *[scene((RED, 20 + 3 * n, 60, 70 + 3 * n, 200), (BLUE, 300, 50, 350, 190)) for n in range(40)]
    )
    for number, each in enumerate(seen):
        assert each.target is TargetState.TRACKED
        assert each.box.cx * COLUMNS == pytest.approx(45 + 3 * number, abs=2)
        assert (each.mask[part(20 + 3 * number, 60, 70 + 3 * number, 200)] == TARGET).mean() > 0.9
        assert (each.mask == PERSON).any()


def test_a_lost_target_is_taken_back_only_where_the_detector_is_sure():
    here, nobody = scene((RED, 150, 60, 200, 180)), scene()
    seen = doubtful(*[here] * 5, *[nobody] * 30, *[here] * 20)
    assert seen[34].target is TargetState.LOST
    assert all(each.box is None and not each.mask.any() for each in seen[35:])


def test_a_doubtful_box_on_somebody_else_is_not_the_targets():
    """Green steps before red, of whom the detector still gives the same box."""
    here = scene((RED, 150, 60, 200, 180))
    behind = scene((RED, 150, 60, 200, 180), (GREEN, 152, 62, 198, 180))
    seen = doubtful(*[here] * 5, *[behind] * 4)
    assert all(each.box is None for each in seen[5:])


def test_who_leaves_the_picture_is_not_drawn_at_its_edge_for_long():
    pictures = [scene((RED, 340 + 12 * n, 60, 400, 200)) for n in range(4)] + [scene()] * 10
    seen = watch(film(*pictures))
    for each in seen:
        assert each.box is None or 0 < each.box.w <= 1
    assert seen[-1].box is None


def test_where_somebody_else_is_found_the_target_is_not_expected():
    """Green steps before red, who is hidden then."""
    here = scene((RED, 150, 60, 200, 180))
    behind = scene((GREEN, 148, 58, 202, 182))
    seen = watch(film(*[here] * 4, *[behind] * 3))
    assert all(each.box is None for each in seen[4:])
    assert not (seen[5].mask == TARGET).any()
