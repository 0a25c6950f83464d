"""A target that was gone is taken back from any side, and nobody else in its place."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from adatracker_deploy.core.messages import TargetState
from adatracker_deploy.perception.target.lock import TargetLock
from adatracker_deploy.perception.target.recognition import COAST_S
from tests.perception.target.walkers import (
    CLOTHES,
    RATE_HZ,
    SIMILAR,
    Walker,
    along,
    answers,
    follow,
    followed,
    looking,
    mixture,
    sights,
    states,
    steady,
)

TRACKED, COASTING, LOST = TargetState.TRACKED, TargetState.COASTING, TargetState.LOST


@pytest.mark.parametrize("clothes", [name for name in (*CLOTHES, *SIMILAR) if name != "red"])
def test_somebody_in_other_clothes_never_takes_the_place_of_who_has_left(clothes):
    walkers = [
        Walker("red", steady(200), here=lambda t_s: t_s < 2),
        Walker(clothes, along((3, 5), (20, 200)), here=lambda t_s: t_s >= 3),
    ]
    said = follow(walkers, 20)
    assert set(states(said)[round((2 + COAST_S) * RATE_HZ) + 1 :]) == {LOST}
    assert set(followed(said)) == {0, None}


def test_a_twin_who_stood_beside_the_target_is_not_taken_for_them():
    walkers = [
        Walker("red", steady(150), here=lambda t_s: t_s < 2),
        Walker("red", along((0, 4, 6), (300, 300, 150))),
    ]
    said = follow(walkers, 12)
    assert 1 not in followed(said)
    assert states(said)[-1] is LOST


def test_a_twin_who_stood_beside_the_target_is_no_reason_not_to_take_it_back():
    walkers = [
        Walker("red", steady(150), here=lambda t_s: not 2 < t_s < 4),
        Walker("red", steady(300)),
    ]
    said = follow(walkers, 7)
    assert set(followed(said)) == {0, None}
    assert states(said)[-1] is TRACKED


def test_a_target_that_comes_back_elsewhere_is_taken_back_before_it_counts_as_lost():
    """It is expected where it was going; here it turns round behind what hides it for half a second."""
    hidden_s, back_s = 2.0, 2.5
    walker = Walker(
        "red",
        along((0, hidden_s, back_s), (100, 300, 180)),
        here=lambda t_s: not hidden_s < t_s < back_s,
    )
    said = follow([walker], 4)
    first = round(back_s * RATE_HZ)
    assert followed(said)[first : first + 2] == [None, None]
    assert set(followed(said)[first + 2 :]) == {0}
    assert LOST not in states(said)


def test_whoever_stood_beside_the_target_is_not_taken_for_it_while_it_may_be_where_it_is_expected():
    walkers = [
        Walker("red", steady(150), here=lambda t_s: t_s < 2),
        Walker("red with green trousers", steady(300), here=lambda t_s: t_s < 2),
        Walker("red", steady(300), here=lambda t_s: t_s >= 2),  # changed clothes: most alike, and known
    ]
    said = follow(walkers, 1.9 + COAST_S)
    assert set(states(said)[round(2.1 * RATE_HZ) :]) == {COASTING}


def test_while_somebody_stands_where_the_target_is_expected_it_is_behind_them_and_nobody_who_comes():
    walkers = [
        Walker("red", steady(200)),
        Walker("green", along((0, 1, 9), (330, 200, 200))),
        Walker("red", steady(60), here=lambda t_s: t_s >= 1.2),
    ]
    said = follow(walkers, 1.6)
    assert states(said)[-1] is COASTING
    assert 2 not in followed(said)


@pytest.mark.parametrize("tall", [30, 150])
def test_who_was_last_seen_in_part_is_taken_back_at_any_size(tall):
    """A box at the edge of the picture is as tall as what is left of the person in it."""
    walkers = [
        Walker("red", steady(200), here=lambda t_s: t_s < 2, tall=60),
        Walker("red", steady(200), here=lambda t_s: t_s >= 3.2, tall=tall),
    ]
    assert states(follow(walkers, 3.6))[-1] is TRACKED


@pytest.mark.parametrize(("tall", "taken"), [(150, False), (100, True)])
def test_who_is_much_nearer_than_a_target_that_has_just_gone_came_between(tall, taken):
    """Somebody in like clothes appears as the target goes, and not beside it."""
    walkers = [
        Walker("red", steady(150), here=lambda t_s: t_s < 2),
        Walker("red", steady(250), here=lambda t_s: t_s >= 2.2, tall=tall),
    ]
    said = follow(walkers, 4)
    assert (1 in followed(said)) is taken


@pytest.mark.parametrize(("score", "taken"), [(0.49, False), (0.51, True)])
def test_of_whom_the_detector_is_not_sure_nobody_is_taken_back(score, taken):
    lock, last = TargetLock(), None
    for sight in sights([Walker("red", steady(150), here=lambda t_s: not 2 < t_s < 4)], 6):
        if last is None:
            lock.choose(0, sight.boxes, sight.looks, sight.t_ns)
        scores = np.full(len(sight.who), score if sight.t_ns > 9e9 + 7e8 else 0.9, np.float32)
        last = lock.update(sight.boxes, scores, sight.looks, sight.motion, sight.t_ns)
    assert (last.place == 0) is taken


@pytest.mark.parametrize("around", [1, -1])
def test_who_is_met_again_after_a_full_turn_is_taken_back(around):
    """The camera has carried the place where the target was lost round the whole world, 2,000 px away."""
    walkers = [Walker("red", lambda t_s: 240 + 2000 * around * (t_s > 2.5)), Walker("blue", steady(900))]
    said = follow(walkers, 5.5, pan=along([1, 4], [0, 2000 * around]))
    assert states(said)[round(2.5 * RATE_HZ)] is LOST
    assert states(said)[-1] is TRACKED
    assert followed(said)[-1] == 0


def _turning(kinds, blends=20):
    """Return looks that go over from kind to kind, each seen for 4 s: of a target that turns round."""
    looks = []
    for before, after in itertools.pairwise(kinds):
        looks += [looking([before])] * 80
        for share in np.linspace(0, 1, blends):
            looks.append(np.sqrt((1 - share) * looking([before]) ** 2 + share * looking([after]) ** 2))
    return looks + [looking([kinds[-1]])] * 80


@pytest.mark.parametrize("kind", [0, 4, 6])
def test_a_target_that_was_seen_from_all_sides_is_taken_back_from_any(kind):
    here = np.array([(100, 20, 140, 120)], np.float32)
    nobody = here[:0], looking([])
    pictures = [(here, look) for look in _turning([0, 2, 4, 6, 8])]
    said = answers((here, looking([0])), [*pictures, *[nobody] * 40, *[(here, looking([kind]))] * 5])
    assert {state for state, _ in said[: len(pictures)]} == {TRACKED}
    assert said[-1] == (TRACKED, 0)


def test_no_view_is_kept_of_whom_somebody_has_just_crossed():
    """It may be somebody else by now."""
    here, half = np.array([(100, 20, 140, 120)], np.float32), mixture(0.6)
    both = np.vstack((here, here + np.float32([20, 0, 20, 0]))), np.concatenate((half, looking([2])))
    alone, changed, nobody = (here, looking([0])), (here, half), (here[:0], looking([]))
    crossed = [*[both] * 10, *[changed] * 15, *[alone] * 120]
    said = answers(alone, [*[alone] * 60, *crossed, *[nobody] * 40, *[changed] * 20])
    assert {state for state, _ in said[: 60 + len(crossed)]} == {TRACKED}
    assert {state for state, _ in said[-20:]} == {LOST}


def test_nothing_is_learnt_of_a_target_that_is_half_covered():
    """Otherwise somebody who looks like a mix of both would later be taken for the target."""
    own, passers, half = looking([0]), looking([2]), mixture(0.6)
    here = np.array([(100, 20, 140, 120)], np.float32)
    both = np.vstack((here, here + np.float32([20, 0, 20, 0])))
    alone, together = (here, own), (both, np.concatenate((half, passers)))
    nobody = here[:0], own[:0]
    said = answers(alone, [alone] * 60 + [together] * 100 + [nobody] * 30 + [(here, half)] * 20)
    assert {state for state, _ in said[:160]} == {TRACKED}
    assert {state for state, _ in said[-30:]} == {LOST}


def test_of_two_who_come_and_look_the_same_neither_is_taken():
    walkers = [
        Walker("red", steady(200), here=lambda t_s: t_s < 2),
        Walker("red", steady(150), here=lambda t_s: t_s >= 4),
        Walker("red", steady(250), here=lambda t_s: t_s >= 4),
    ]
    assert states(follow(walkers, 10))[-1] is LOST


@pytest.mark.parametrize(("missed", "place"), [(4, 0), (10, None)])
def test_the_longer_a_target_was_missed_the_more_a_box_in_its_place_must_look_like_it(missed, place):
    """Pictures of 50 ms; after half a second somebody else may stand there."""
    here, nowhere = np.array([(100, 20, 140, 120)], np.float32), np.empty((0, 4), np.float32)
    own, hardly = looking([0]), mixture(0.7)
    pictures = [*[(here, own)] * 20, *[(nowhere, own[:0])] * missed, (here, hardly), (here, own)]
    said = answers((here, own), pictures)
    assert said[-2][1] == place
    assert said[-1] == (TRACKED, 0)
