"""The target is chosen over several pictures: never by one mistake, nor who is behind one who is missed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.perception.roles import Instances
from adatracker_deploy.perception.target.choice import Choice
from adatracker_deploy.perception.target.first_sight import (
    LEAST_SCORE,
    PATIENCE_S,
    SURE_SCORE,
    TRUSTED_S,
    TRUSTED_SCORE,
    TRUSTED_SIGHTS,
    VOUCHED_S,
    FirstSight,
)

WIDTH, HEIGHT = 400, 200
NEAR, FAR = (150, 20, 230, 190), (180, 60, 205, 120)
RATE_HZ = 10.0


def people(*found):
    """Return the people found, given as (box, score)."""
    return Instances(
        np.array([box for box, _ in found], np.float32).reshape(-1, 4),
        np.array([score for _, score in found], np.float32),
        ("person",) * len(found),
    )


def first_chosen(pictures, rule="ahead", rate_hz=RATE_HZ):
    """Return the number of the picture in which somebody is chosen, and their box; None if nobody is."""
    first_sight = FirstSight(Choice.read(rule))
    for number, found in enumerate(pictures):
        crowd = people(*found)
        place = first_sight(crowd, WIDTH, HEIGHT, round(number * 1e9 / rate_hz))
        if place is not None:
            return number, tuple(crowd.boxes[place].tolist())
    return None


@pytest.mark.parametrize("rate_hz", [5.0, 10.0, 20.0, 60.0])
def test_who_stands_there_is_chosen_once_seen_often_and_long_enough(rate_hz):
    number, box = first_chosen([[(NEAR, 0.8)]] * 60, rate_hz=rate_hz)
    assert box == NEAR
    assert number + 1 >= TRUSTED_SIGHTS
    assert TRUSTED_S <= number / rate_hz <= max(TRUSTED_S, (TRUSTED_SIGHTS - 1) / rate_hz) + 1 / rate_hz


def test_one_picture_alone_chooses_nobody():
    assert first_chosen([[(NEAR, 0.99)]]) is None
    assert first_chosen([[(NEAR, 0.99)], *[[]] * 50]) is None


def test_somebody_seen_from_behind_is_chosen_by_a_low_score():
    assert first_chosen([[(NEAR, 0.4)]] * 10)[1] == NEAR
    assert first_chosen([[(NEAR, TRUSTED_SCORE - 0.01)]] * 50) is None


@pytest.mark.parametrize("rule", ["ahead", "largest", "0.48,0.5"])
def test_whoever_is_behind_is_not_chosen_while_the_near_one_is_in_doubt(rule):
    """The near one is missed in half of the pictures, and unsure in the others."""
    doubtful = [[(NEAR, 0.3), (FAR, 0.9)] if number % 2 else [(FAR, 0.9)] for number in range(12)]
    sure = [[(NEAR, 0.6), (FAR, 0.9)]] * 12
    assert first_chosen(doubtful + sure, rule)[1] == NEAR


def test_somebody_in_doubt_is_not_waited_for_for_ever():
    number, box = first_chosen([[(NEAR, 0.25), (FAR, 0.9)]] * 50)
    assert box == FAR
    assert number / RATE_HZ == pytest.approx(PATIENCE_S, abs=0.11)


def test_a_mistake_that_comes_and_goes_is_nobody_and_holds_nobody_up():
    large = (0, 0, 300, 200)
    pictures = [[(large, 0.5), (NEAR, 0.8)], *[[(NEAR, 0.8)]] * 20]
    number, box = first_chosen(pictures)
    assert box == NEAR
    assert number / RATE_HZ < 1.0


def test_who_passes_the_point_is_not_who_was_meant():
    """Somebody crosses the point for a moment before who stands there is found."""
    passing = [[((20 + 60 * n, 20, 80 + 60 * n, 190), 0.9)] for n in range(6)]
    standing = [[(NEAR, 0.8)]] * 10
    assert first_chosen(passing + standing, "0.48,0.5")[1] == NEAR


def test_the_nth_from_the_left_is_counted_once_nobody_is_in_doubt():
    left, right = (20, 40, 60, 190), (300, 40, 340, 190)
    pictures = [[(right, 0.8)], [(right, 0.8)], *[[(left, 0.7), (right, 0.8)]] * 20]
    assert first_chosen(pictures, "#1")[1] == left


share = st.floats(0, 1)
boxes = st.tuples(share, share, share, share).map(
    lambda b: (b[0] * 300, b[1] * 100, b[0] * 300 + 5 + b[2] * 90, b[1] * 100 + 5 + b[3] * 90)
)


@given(
    st.lists(st.lists(st.tuples(boxes, share), max_size=4), max_size=30),
    st.sampled_from(["ahead", "largest", "best", "#2"]),
)
def test_whoever_is_chosen_is_in_that_picture_and_not_nobody(pictures, rule):
    first_sight = FirstSight(Choice.read(rule))
    for number, found in enumerate(pictures):
        place = first_sight(people(*found), WIDTH, HEIGHT, number * 100_000_000)
        if place is not None:
            assert found[place][1] >= LEAST_SCORE
            assert number + 1 >= TRUSTED_SIGHTS
            return


def first_vouched(pictures, witness):
    """Return after how long somebody is chosen, s, and their box; None if nobody is.

    The witness is given a box; it is asked once a picture at most, for it takes as long as the target's mask.
    """
    first_sight = FirstSight(Choice())
    for number, found in enumerate(pictures):
        crowd, asked = people(*found), []

        def vote(place, crowd=crowd, asked=asked):
            asked.append(place)
            return witness(tuple(crowd.boxes[place].tolist()))

        place = first_sight(crowd, WIDTH, HEIGHT, round(number * 1e9 / RATE_HZ), vote)
        assert len(asked) <= 1
        if place is not None:
            return number / RATE_HZ, tuple(crowd.boxes[place].tolist())
    return None


def test_whom_the_detector_hardly_sees_is_chosen_on_the_word_of_a_witness():
    pictures = [[(NEAR, 0.22)] if number % 2 else [] for number in range(40)]
    after_s, box = first_vouched(pictures, lambda box: 0.99)
    assert box == NEAR
    assert VOUCHED_S <= after_s < PATIENCE_S
    assert first_vouched(pictures, lambda box: 0.7) is None


def test_of_whom_the_detector_is_sure_a_witness_may_be_in_doubt():
    after_s, box = first_vouched([[(NEAR, SURE_SCORE + 0.05)]] * 10, lambda box: 0.6)
    assert (after_s, box) == (TRUSTED_S, NEAR)


def test_what_a_witness_sees_nobody_in_is_not_preferred_and_holds_nobody_up():
    """A tree, nearer than the person, of which the detector thinks a little."""
    tree = (0, 0, 300, 200)
    for score in (0.3, SURE_SCORE + 0.1):
        after_s, box = first_vouched([[(tree, score), (NEAR, 0.8)]] * 40, lambda box: float(box != tree))
        assert box == NEAR
        assert after_s < 1.0


def test_who_is_there_for_long_is_chosen_against_a_witness_that_knows_only_who_stands():
    """Somebody on a skateboard; but what the detector hardly sees stays nobody."""
    after_s, box = first_vouched([[(NEAR, TRUSTED_SCORE + 0.05)]] * 40, lambda box: 0.1)
    assert box == NEAR
    assert after_s == pytest.approx(PATIENCE_S, abs=0.11)
    assert first_vouched([[(NEAR, TRUSTED_SCORE - 0.05)]] * 60, lambda box: 0.1) is None
