"""Every rule for choosing the target chooses the right person."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.target.choice import Choice

WIDTH, HEIGHT = 400, 200


def people(*boxes, scores=None):
    """Somebody in each box, in px: the boxes in fractions of the picture, and the scores."""
    sure = [0.8] * len(boxes) if scores is None else scores
    corners = np.array(boxes, np.float32).reshape(-1, 4) / (WIDTH, HEIGHT, WIDTH, HEIGHT)
    return corners.astype(np.float32), np.array(sure, np.float32)


LEFT, MIDDLE, RIGHT = (10, 40, 60, 190), (180, 60, 220, 150), (300, 20, 380, 199)
CROWD = people(MIDDLE, RIGHT, LEFT, scores=(0.6, 0.7, 0.9))


def chosen(text, crowd=CROWD):
    return Choice.read(text)(*crowd)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("ahead", 0),
        ("largest", 1),
        ("central", 0),
        ("best", 2),
        ("#1", 2),
        ("#2", 0),
        ("#3", 1),
        ("#4", None),
        ("0.1,0.5", 2),  # x of 400, y of 200
        ("0.85,0.9", 1),
        ("0.6,0.5", None),
        ("0.45,0.3,0.55,0.75", 0),
        ("0.73,0.05,0.96,1", 1),
        ("0,0,1,1", None),  # overlaps everybody, and is nobody's box
        ("0.6,0.1,0.7,0.9", None),
    ],
)
def test_a_rule_a_number_a_point_and_a_box_each_choose(text, place):
    assert chosen(text) == place


def test_the_default_is_whom_the_robot_points_at():
    assert Choice() == Choice.read("ahead")


AHEAD = (180, 60, 220, 150)


@pytest.mark.parametrize(
    ("other", "place"),
    [
        ((284, 25, 371, 171), 0),  # nearer, and aside: whoever passes
        ((40, 0, 130, 199), 0),
        ((192, 90, 206, 122), 0),  # far behind, and nearer to the middle
        ((150, 0, 230, 199), 1),  # nearer, and ahead as well
    ],
)
def test_of_people_near_and_far_it_is_the_one_whom_the_robot_points_at(other, place):
    assert chosen("ahead", people(AHEAD, other)) == place


@given(st.integers(0, 400), st.integers(0, 200))
def test_nobody_smaller_and_farther_aside_is_whom_the_robot_points_at(left, height):
    aside = (left, 100 - height / 2, left + 30, 100 + height / 2)
    if abs(left + 15 - 200) > 15:
        assert chosen("ahead", people((185, 0, 245, 200), aside)) == 0


def test_of_two_whose_boxes_hold_the_point_it_is_the_one_whose_middle_is_nearer():
    crowd = people((100, 0, 200, 200), (150, 0, 300, 200))
    assert chosen("0.42,0.5", crowd) == 0
    assert chosen("0.48,0.5", crowd) == 1


def test_the_middle_is_that_of_the_picture_in_fractions_of_both_sides():
    crowd = people((240, 80, 260, 120), (190, 20, 210, 100))  # 50 px aside: 0.125; 40 px above: 0.2
    assert chosen("central", crowd) == 0


@pytest.mark.parametrize("text", ["ahead", "largest", "central", "best", "#1", "0.5,0.5", "0.2,0.1,0.9,0.9"])
def test_where_nobody_is_nobody_is_chosen(text):
    assert chosen(text, people()) is None
    assert chosen(text, people((80, 20, 360, 180))) == 0


@pytest.mark.parametrize(
    "text",
    [
        "",
        "biggest",
        "Largest",
        " largest",
        "#0",
        "#",
        "#-1",
        "#1.5",
        "#100",
        "#1 ",
        "0.5",
        "0.5,0.5,0.6",
        "0.1,0.2,0.3,0.4,0.5",
        "0.5,",
        "0.5;0.5",
        "a,b",
        "nan,0.5",
        "inf,0.5",
        "-0.1,0.5",
        "0.5,1.1",
        "320,240",
        "0.6,0.2,0.4,0.9",
        "0.4,0.9,0.6,0.2",
        "0.4,0.2,0.4,0.9",
        "0.1,0.2,0.3,nan",
    ],
)
def test_what_is_no_choice_is_refused_with_what_would_be(text):
    with pytest.raises(UsageError) as refused:
        Choice.read(text)
    assert f"target {text!r}: expected ahead, largest, central, best, click, #N" in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


@given(st.text(max_size=12))
def test_any_text_is_a_choice_or_refused(text):
    try:
        choice = Choice.read(text)
    except UsageError:
        return
    assert choice(*CROWD) in (None, 0, 1, 2)


share = st.floats(0, 1)


@given(
    st.lists(st.tuples(share, share, share, share, share), max_size=6),
    st.sampled_from(["ahead", "largest", "central", "best", "#1", "#3", "0.5,0.5", "0.2,0.2,0.8,0.8"]),
)
def test_whoever_is_chosen_is_in_sight(found, text):
    boxes = [(x * 390, y * 190, x * 390 + 1 + w * 9, y * 190 + 1 + h * 9) for x, y, w, h, _ in found]
    place = chosen(text, people(*boxes, scores=[each[-1] for each in found]))
    assert place is None or 0 <= place < len(found)
