"""Prediction of each person's box in the next picture, and assignment of the detected boxes to people."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.perception.target.motion import STILL
from adatracker_deploy.perception.target.people import Person, assigned

BOX = np.array([100, 50, 140, 150], np.float32)
WHOLE = np.zeros(2, bool)


def aside(px, box=BOX):
    """Return the box moved to the right by `px`."""
    return box + np.float32([px, 0, px, 0])


def look(kind=0):
    made = np.zeros((3, 128), np.float32)
    made[:, kind] = 1
    return made


def walked(speed_px_s, pictures, dt_s=0.05, motion=STILL):
    """Return a person seen in each picture, whose box moves with their own speed and the camera's motion."""
    person, box = Person.new(BOX, look()), BOX.astype(float)
    for _ in range(pictures):
        step = np.array([speed_px_s * dt_s, 0] * 2) + np.tile(motion[:, 2], 2)
        box = box + step
        person = person.expected(motion, dt_s).seen(box.astype(np.float32), look(), 0.1)
    return person


def test_who_walks_is_expected_to_walk_on():
    person = walked(80, 30)
    assert person.velocity == pytest.approx((80, 0), abs=1)
    later = person.expected(STILL, 0.5)
    assert later.box == pytest.approx(aside(40, person.box), abs=1)
    assert later.unseen_s == 0.5


def test_after_a_second_out_of_sight_nobody_is_expected_to_go_on():
    person = walked(80, 30)
    for _ in range(60):
        person = person.expected(STILL, 0.05)
    assert person.unseen_s == pytest.approx(3)
    assert person.box[0] == pytest.approx(walked(80, 30).box[0] + 80 * 1.0, abs=5)


def test_the_cameras_motion_is_not_the_persons():
    pan = np.array([[1, 0, -40], [0, 1, 0]], float)
    person = walked(0, 20, motion=pan)
    assert person.velocity == pytest.approx((0, 0), abs=1e-6)
    assert person.expected(pan, 0.05).box == pytest.approx(aside(-40, person.box))


def test_a_camera_that_rolls_turns_the_place_and_not_the_size():
    turn = np.array([[0, -1, 0], [1, 0, 0]], float)  # a quarter: (x, y) -> (-y, x)
    person = Person.new(BOX, look()).expected(turn, 0.05)
    assert person.box == pytest.approx([-120, 70, -80, 170])


def test_a_camera_that_zooms_makes_them_larger():
    person = Person.new(BOX, look()).expected(np.array([[1.2, 0, 0], [0, 1.2, 0]]), 0.05)
    assert person.box == pytest.approx(BOX * 1.2)


def test_who_is_out_of_sight_for_longer_than_a_second_grows_no_more_as_the_background_does():
    person, zoom = Person.new(BOX, look()), np.array([[1.05, 0, 0], [0, 1.05, 0]])
    tall = []
    for _ in range(60):
        person = person.expected(zoom, 0.05)
        tall.append(person.box[3] - person.box[1])
    assert tall[18] > 200
    assert tall[-1] == pytest.approx(tall[25])


def test_only_the_share_of_a_look_that_is_given_is_learnt():
    person = Person.new(BOX, look(0))
    assert person.seen(BOX, look(1), 0).look is person.look
    learnt = person.seen(BOX, look(1), 0.1)
    assert learnt.alike(look(1)[None])[0] == pytest.approx(np.sqrt(0.1), abs=1e-6)
    assert learnt.unseen_s == 0


def test_two_pictures_of_one_moment_do_no_harm():
    person = Person.new(BOX, look()).expected(STILL, 0.0).seen(BOX + 1, look(), 0.1)
    assert np.isfinite(person.velocity).all()


def shares(people, kinds):
    """Return the likeness of each person to each box's look, shape (people, boxes)."""
    rows = [person.alike(np.array([look(kind) for kind in kinds])) for person in people]
    return np.array(rows).reshape(len(people), len(kinds))


def pairs(*arguments):
    return assigned(*arguments)[0]


def whose(people, boxes, kinds, least=0.4):
    found = np.array(boxes, float).reshape(-1, 4)
    return pairs(people, found, shares(people, kinds), [least] * len(people), np.zeros(len(found), bool))


def test_the_best_pair_comes_first_and_the_next_gets_what_is_left():
    a, b = Person.new(BOX, look()), Person.new(aside(30), look())
    near_b, beyond_b = aside(28), aside(90)
    assert whose([a, b], [near_b, beyond_b], [0, 0]) == {1: 0}  # the second is too far from the first
    assert whose([a, b], [near_b, aside(5)], [0, 0]) == {0: 1, 1: 0}


def test_a_look_decides_between_two_who_stand_in_one_place():
    a, b = Person.new(BOX, look(0)), Person.new(BOX, look(1))
    assert whose([a, b], [BOX, BOX], [1, 0]) == {0: 1, 1: 0}


@pytest.mark.parametrize(("likeness_here", "place"), [(0.5, 1), (0.7, 0)])
def test_likeness_counts_twice_as_much_as_place(likeness_here, place):
    """The first box is where they must be; the other overlaps it little and looks exactly like them."""
    someone = Person.new(BOX, look())
    boxes = np.array([BOX, aside(33)], float)
    assert pairs([someone], boxes, np.array([[likeness_here, 1.0]]), [0.4], WHOLE) == {0: place}


@pytest.mark.parametrize(
    ("box", "kind"),
    [
        (BOX, 1),
        (aside(300), 0),
        ([110, 90, 130, 149], 0),
        ([60, 0, 180, 180], 0),
    ],
    ids=["other clothes", "too far", "too small", "too large"],
)
def test_a_box_that_cannot_be_theirs_is_nobodys(box, kind):
    assert whose([Person.new(BOX, look())], [box], [kind]) == {}


def test_whom_the_picture_cuts_off_is_known_by_their_width():
    """Somebody walks out below the picture, and back into it: of them it shows less and less, then all."""
    whole, head = BOX.astype(float), np.array([[102, 50, 138, 80]], float)
    cut_look = look()
    cut_look[1:] = 0
    person = Person.new(BOX, look())
    alike = np.array([[0.9]])
    assert pairs([person], head, alike, [0.4], WHOLE[:1]) == {}
    assert pairs([person], head, alike, [0.4], ~WHOLE[:1]) == {0: 0}
    again = person.seen(head[0].astype(np.float32), cut_look, 0)
    assert pairs([again], whole[None], alike, [0.4], WHOLE[:1]) == {0: 0}
    assert pairs([again], whole[None] + [[-80, 0, 80, 0]], alike, [0.4], WHOLE[:1]) == {}
    assert (
        pairs([again.seen(head[0].astype(np.float32), look(), 0)], whole[None], alike, [0.4], WHOLE[:1]) == {}
    )


def test_the_longer_somebody_was_out_of_sight_the_further_they_may_have_gone():
    elsewhere = aside(70)
    person = Person.new(BOX, look())
    assert whose([person], [elsewhere], [0]) == {}
    assert whose([person.expected(STILL, 1.0)], [elsewhere], [0]) == {0: 0}


def test_where_nobody_or_nothing_is_there_is_no_pair():
    assert whose([], [BOX], [0]) == {}
    assert pairs([Person.new(BOX, look())], np.empty((0, 4)), np.empty((1, 0)), [0.4], WHOLE[:0]) == {}


places = st.lists(st.tuples(st.integers(0, 30), st.integers(0, 2)), min_size=1, max_size=5, unique=True)


@given(places, places)
def test_nobody_has_two_boxes_no_box_two_owners_and_the_order_does_not_matter(known, found):
    people = [Person.new(aside(9 * x), look(kind)) for x, kind in known]
    boxes = [aside(9 * x) for x, _ in found]
    kinds = [kind for _, kind in found]
    pairs = whose(people, boxes, kinds)
    assert len(set(pairs.values())) == len(pairs)
    for person, box in pairs.items():
        assert known[person][1] == kinds[box]
    for person, box in itertools.product(range(len(people)), range(len(boxes))):
        if known[person] == found[box]:  # stands exactly there, in these clothes
            assert pairs.get(person) == box
    turned = whose(people, boxes[::-1], kinds[::-1])
    for person, box in pairs.items():
        if known[person] in found:
            assert len(boxes) - 1 - turned[person] == box
