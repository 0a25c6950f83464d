"""A click makes somebody else the target: the one who was clicked, wherever they have gone since."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from adatracker_deploy.core.messages import Click, MaskClass, TargetState
from adatracker_deploy.perception.target.choice import Choice
from adatracker_deploy.perception.target_segmenter import TargetSegmenter
from tests.perception.test_target_segmenter import (
    COLUMNS,
    GREEN,
    RED,
    ROWS,
    Colours,
    film,
    part,
    scene,
    watch,
)

pytestmark = pytest.mark.usefixtures("chosen_at_once")

BOTH = (RED, 50, 60, 100, 180), (GREEN, 205, 75, 245, 145)  # red is the larger one


def a_click(seq, x_px, y_px, number=1):
    return Click(number, seq, x_px / COLUMNS, y_px / ROWS)


def clicked(frames, at, click):
    return [replace(frame, click=click) if frame.seq == at else frame for frame in frames]


def centre_px(seen):
    return None if seen.box is None else seen.box.cx * COLUMNS


def test_who_was_clicked_is_the_target_from_that_frame_on():
    frames = clicked(film(*[scene(*BOTH)] * 6), 4, a_click(3, 225, 120))
    seen = watch(frames)
    assert [centre_px(each) for each in seen] == pytest.approx([75] * 3 + [225] * 3)
    assert {each.target for each in seen} == {TargetState.TRACKED}
    assert [each.pick and each.pick.taken for each in seen] == [None] * 3 + [1] * 3
    assert seen[3].pick.box.cx * COLUMNS == pytest.approx(225)
    assert (seen[3].mask[part(*BOTH[1][1:])] == MaskClass.TARGET).all()
    assert (seen[3].mask[part(*BOTH[0][1:])] == MaskClass.PERSON).all()


@pytest.mark.parametrize(("x_px", "y_px"), [(150, 120), (0, 0), (400, 240), (225, 30)])
def test_a_click_on_nobody_changes_nothing_and_says_so(x_px, y_px):
    frames = clicked(film(*[scene(*BOTH)] * 6), 4, a_click(3, x_px, y_px))
    plain, seen = watch(film(*[scene(*BOTH)] * 6)), watch(frames)
    for each, undisturbed in zip(seen, plain, strict=True):
        assert (each.box, each.target, each.confidence) == (
            undisturbed.box,
            undisturbed.target,
            undisturbed.confidence,
        )
        np.testing.assert_array_equal(each.mask, undisturbed.mask)
    assert (seen[3].pick.box, seen[3].pick.taken) == (None, 0)


def test_a_click_on_the_target_itself_is_no_change():
    seen = watch(clicked(film(*[scene(*BOTH)] * 6), 4, a_click(3, 75, 120)))
    assert [centre_px(each) for each in seen] == pytest.approx([75] * 6)
    assert (seen[3].pick.box is not None, seen[3].pick.taken) == (True, 0)


def crossing(number):
    """Green walks to the left, past red who stands."""
    return scene((RED, 100, 50, 150, 170), (GREEN, 300 - 8 * number, 60, 350 - 8 * number, 190))


def test_a_click_means_whom_the_operator_saw_there_not_who_is_there_by_now():
    frames = film(*map(crossing, range(40)))
    late = clicked(frames, 26, a_click(6, 285, 120))  # frame 6: green's place then; by now it passes red
    segmenter = TargetSegmenter(Colours(masks=True), None, Choice.read("best"))
    seen = watch(late, segmenter)
    assert centre_px(seen[5]) == pytest.approx(125)
    assert seen[25].pick.box.cx * COLUMNS == pytest.approx(325 - 8 * 5)  # where green was
    for number in range(30, 37):  # until it is at the picture's edge
        assert centre_px(seen[number]) == pytest.approx(325 - 8 * number)


def test_who_is_hidden_behind_another_by_the_time_of_the_click_is_still_meant():
    frames = film(*map(crossing, range(40)))
    late = clicked(frames, 26, a_click(6, 125, 120))  # where red stood alone, and green is now
    seen = watch(late, TargetSegmenter(Colours(masks=True), None, Choice.read("#2")))
    assert centre_px(seen[5]) == pytest.approx(325 - 8 * 5)
    assert centre_px(seen[-1]) == pytest.approx(125)


def test_a_frame_that_is_no_longer_remembered_is_taken_for_the_newest():
    frames = clicked(film(*[scene(*BOTH)] * 60), 60, a_click(2, 225, 120))  # 2.9 s ago
    assert centre_px(watch(frames)[-1]) == pytest.approx(225)


def test_until_the_new_target_is_seen_there_is_none_and_that_is_said():
    alone, both = scene(BOTH[0]), scene(*BOTH)
    frames = film(*[both] * 5, *[alone] * 8, *[both] * 5)
    seen = watch(clicked(frames, 7, a_click(5, 225, 120)))
    states = [each.target for each in seen]
    assert states[:6] == [TargetState.TRACKED] * 6
    assert states[6:13] == [TargetState.CHOOSING] * 7
    assert states[13:] == [TargetState.TRACKED] * 5
    for each in seen[6:13]:
        assert (each.box, each.confidence, (each.mask == MaskClass.TARGET).any()) == (None, 0, False)
    assert centre_px(seen[13]) == pytest.approx(225)


def test_nobody_is_the_target_before_the_first_click_where_it_is_to_choose():
    frames = clicked(film(*[scene(*BOTH)] * 40), 30, a_click(29, 225, 120))
    seen = watch(frames, TargetSegmenter(Colours(), None, Choice.read("click")))
    assert {(each.box, each.target) for each in seen[:29]} == {(None, None)}
    assert [centre_px(each) for each in seen[29:]] == pytest.approx([225] * 11)


def test_reset_forgets_every_click():
    segmenter = TargetSegmenter(Colours(), None, Choice.read("best"))
    watch(clicked(film(*[scene(*BOTH)] * 5), 4, a_click(3, 225, 120)), segmenter)
    segmenter.reset()
    (seen,) = watch(film(scene(*BOTH)), segmenter)
    assert (centre_px(seen), seen.pick) == (pytest.approx(75), None)
