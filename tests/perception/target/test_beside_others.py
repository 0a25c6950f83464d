"""The lock keeps its person beside others, crossed by them, and in one box with them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from adatracker_deploy.core.messages import TargetState
from adatracker_deploy.perception.target.lock import TargetLock
from adatracker_deploy.perception.target.motion import STILL
from tests.perception.target.walkers import (
    RATE_HZ,
    Walker,
    along,
    answers,
    follow,
    followed,
    looking,
    mixture,
    states,
    steady,
)

TRACKED, COASTING, LOST = TargetState.TRACKED, TargetState.COASTING, TargetState.LOST


@pytest.mark.parametrize(
    ("clothes", "stays_s"),
    [
        *itertools.product(("red", "red with green trousers", "red under a blue coat"), (0.5, 1.5, 3.0)),
        ("red under a blue coat", 6.0),  # who is more alike may be taken for it after five seconds
    ],
)
def test_who_steps_before_the_target_is_not_taken_for_it_and_it_is_found_when_they_have_gone(
    clothes, stays_s
):
    """They touch it from the start, so how alike they are beside it is not known. While it cannot be seen,
    nobody in view is more alike."""
    gone_s = 1.3 + stays_s
    target = Walker("red", steady(240))
    nearer = Walker(clothes, along([1, 1.3, gone_s, gone_s + 2], [275, 240, 240, 420]), tall=130)
    said = follow([target, nearer], gone_s + 5)
    assert 1 not in followed(said)
    assert followed(said)[-1] == 0


@pytest.mark.parametrize(("beside", "back", "soon"), [(1.0, 0.0, True), (0.64, 0.25, False)])
def test_a_target_that_goes_on_under_the_track_of_whom_it_crossed_is_taken_back(beside, back, soon):
    """Tracks are swapped when two cross: what seems to have hidden the target is the target. If they looked
    much less like it beside it, that is plain, and nobody who comes later is taken for it; else only after a
    while."""

    def at(*lefts):
        return np.array([(left, 20, left + 40, 120) for left in lefts], np.float32)

    stranger = mixture(beside)
    both = np.concatenate((looking([0]), stranger))
    pictures = [
        *[(at(100, 170), both)] * 15,
        *[(at(100, left), both) for left in range(170, 114, -5)],
        *[(at(115), stranger)] * 25,
        *[(at(115), mixture(share)) for share in np.linspace(beside, back, 15)],
        *[(at(115), mixture(back))] * 100,
    ]
    alike = len(pictures) - 100
    if soon:
        later = np.concatenate((mixture(back), mixture(0.4)))
        pictures[alike + 10 :] = [(at(115, 300), later)] * 90
    said = answers((at(100), looking([0])), pictures)
    assert said[alike - 15][0] is LOST
    assert (said[alike + 10] == (TRACKED, 0)) is soon
    assert 1 not in [place for _, place in said]
    assert said[-1] == (TRACKED, 0)


@pytest.mark.parametrize("doubtful", [False, True])
@pytest.mark.parametrize("other", [0.1, 0.4])
def test_a_box_that_may_be_of_who_stands_before_the_target_is_theirs_however_like_it_they_look(
    other, doubtful
):
    """For one picture both are in one box, which leads their track astray; then they look like the target."""

    def at(*lefts):
        return [(left, 57, left + 54, 207) for left in lefts]

    target, own, beside = (130, 60, 167, 171), looking([0]), np.concatenate((looking([0]), mixture(other)))
    pictures = [
        *[([target, *at(left)], beside) for left in range(260, 150, -6)],
        ([(105, 45, 204, 219)], mixture(other)),
        *[(at(left), own) for left in (*range(138, 118, -4), *range(118, 80, -6))],
        *[([target, *at(left)], beside) for left in range(80, -10, -6)],
    ]
    sure = [len(boxes) for boxes, _ in pictures]
    if doubtful:
        after = sure.index(1) + 1
        sure[after : after + 5] = [0] * 5
    said = answers(
        (np.array([target, *at(260)], np.float32), beside),
        [(np.array(boxes, np.float32), looks) for boxes, looks in pictures],
        sure=sure,
    )
    assert [place for _, place in said] == [0 if len(boxes) == 2 else None for boxes, _ in pictures]


def test_a_target_keeps_its_box_beside_somebody_who_is_missed():
    """They walk side by side, and its box is larger for the picture in which there is none on the other."""

    def at(left):
        return np.array([(100, 20, 140, 120), (left, 20, left + 40, 120)], np.float32)

    both, grown = np.concatenate((looking([0]), mixture(0.1))), np.array([(97, 8, 143, 128)], np.float32)
    pictures = [
        *[(at(left), both) for left in range(160, 115, -3)],
        *[(at(115), both)] * 5,
        (grown, looking([0])),
        *[(at(115), both)] * 5,
    ]
    assert set(answers((at(160), both), pictures)) == {(TRACKED, 0)}


def test_a_second_box_on_the_target_does_not_take_its_next_box():
    """A wide box with an arm and a narrow one without, for one picture; after that the wide one alone."""
    narrow, wide = np.array([[100, 50, 145, 150]], np.float32), np.array([[100, 50, 170, 150]], np.float32)
    lock, one, two = TargetLock(), np.ones(1, np.float32), np.ones(2, np.float32)
    lock.choose(0, narrow, looking([0]), 0)
    pictures = [narrow, np.vstack((narrow, wide)), wide, wide]
    for number, boxes in enumerate(pictures, 1):
        kinds = [0] * len(boxes)
        said = lock.update(boxes, (one, two)[len(boxes) - 1], looking(kinds), STILL, number * 10**8)
        assert said.state is TRACKED


def test_a_second_box_on_the_target_itself_does_not_hide_it():
    """Detectors split a person who is half hidden; the box that grows to the whole of them is the target."""
    half, whole = (np.array([(100, 20, 140, bottom)], np.float32) for bottom in (70, 120))
    own = looking([0])
    two = np.vstack((half, whole)), np.concatenate((own, own))
    said = answers((half, own), [*[(half, own)] * 20, *[two] * 3, *[(whole, own)] * 60])
    assert said[-1] == (TRACKED, 0)


def test_a_target_that_stood_beside_whom_the_lock_had_taken_for_it_is_taken_back():
    """The lock's mistake does not make the target a stranger: it still looks more like itself."""
    here, elsewhere = np.array([(100, 20, 140, 120)], np.float32), np.array([(200, 20, 240, 120)], np.float32)
    own = looking([0])
    alone, wrong = (here, own), (here, mixture(0.4))
    both = np.vstack((here, elsewhere)), np.concatenate((mixture(0.4), own))
    pictures = [wrong, *[both] * 15, *[(elsewhere, own)] * 40]
    said = answers(alone, pictures)
    assert [place for _, place in said[1:10]] == [0] * 9  # the lock is wrong
    assert said[-1] == (TRACKED, 0)


@pytest.mark.parametrize("touched", [False, True], ids=["standing free", "touched by somebody"])
def test_a_target_that_turns_round_beside_somebody_like_it_keeps_its_place(touched):
    """They look a little more like it now than it does itself, but much more like themselves.

    Where somebody touches the target, tracks may be swapped, and its place is doubted.
    """
    places = [(100, 20, 140, 120), (200, 20, 240, 120), (125, 20, 165, 120)][: 2 + touched]
    boxes, own, passer = np.array(places, np.float32), looking([0]), [looking([2])] * touched
    another_view = np.sqrt(0.4 * np.square(own) + 0.6 * np.square(looking([3])))
    facing = np.concatenate((own, mixture(0.5), *passer))
    turned = np.concatenate((another_view, mixture(0.35), *passer))
    said = answers((boxes, facing), [*[(boxes, facing)] * 40, *[(boxes, turned)] * 20])
    assert said[:40] == [(TRACKED, 0)] * 40
    assert said[40] == ((COASTING, None) if touched else (TRACKED, 0))
    assert touched or said[41:] == [(TRACKED, 0)] * 19


def _parting(before, pictures):
    """Return what is found of two of whom the right one looks as was chosen and the left one in part: first
    only the left one, then both, who step apart."""
    left = np.array([(100, 20, 140, 120)], np.float32)
    parted = []
    for number in range(pictures):
        right = left + np.array([30 + min(5 * number, 60), 0] * 2, np.float32)
        parted.append((np.vstack((left, right)), np.concatenate((looking([2]), looking([0])))))
    return [(left, looking([2]))] * before + parted


def test_of_two_who_were_chosen_in_one_box_the_target_is_who_looks_more_like_it():
    both = np.array([(100, 20, 160, 120)], np.float32)
    said = answers((both, mixture(0.45)), _parting(2, 20))
    assert [place for _, place in said[:6]] == [0] * 6
    assert said[-1] == (TRACKED, 1)


def test_whoever_parts_from_the_target_much_later_is_somebody_else():
    both = np.array([(100, 20, 160, 120)], np.float32)
    said = answers((both, mixture(0.45)), _parting(70, 20))
    assert said[-1] == (TRACKED, 0)


def test_whoever_comes_from_elsewhere_was_not_in_the_box_that_was_chosen():
    alone = np.array([(100, 20, 140, 120)], np.float32)
    beside = np.vstack((alone, alone + np.array([90, 0] * 2, np.float32)))
    looks = np.concatenate((looking([2]), looking([0])))
    said = answers((alone, mixture(0.45)), [(alone, looking([2])), *[(beside, looks)] * 30])
    assert said[-1] == (TRACKED, 0)


@pytest.mark.parametrize(
    ("now", "stranger"), [(325, 200), (265, 235)], ids=["far away", "half behind the stranger"]
)
def test_who_comes_to_where_the_target_must_be_is_not_taken_while_it_stands_elsewhere(now, stranger):
    """The target jumps further than anybody can walk, as when pictures are missing or the camera is hit."""
    walkers = [
        Walker("red", lambda t_s: 200 if t_s < 2 else now),
        Walker("red with green trousers", steady(stranger), here=lambda t_s: t_s >= 2.2),
    ]
    said = follow(walkers, 6)
    assert set(followed(said)) == {0, None}
    assert states(said)[round(2.2 * RATE_HZ)] is COASTING
    assert states(said)[-1] is (TRACKED if now == 325 else LOST)  # who does not stand free is not taken back


@pytest.mark.parametrize("jump", [36, 90])
def test_whom_a_target_that_jumps_uncovers_is_not_taken_for_it(jump):
    walkers = [
        Walker("red with green trousers", steady(200)),
        Walker("red", lambda t_s: 200 if t_s < 1 else 200 - jump),
    ]
    said = follow(walkers, 5, target=1)
    assert set(followed(said)) == {1, None}
    assert states(said)[-1] is TRACKED
