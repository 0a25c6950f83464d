"""The lock keeps one person through crowds and out of sight; nobody else silently takes their place."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from adatracker_deploy.core.messages import TargetState
from adatracker_deploy.perception.target.lock import TargetLock
from adatracker_deploy.perception.target.motion import STILL
from adatracker_deploy.perception.target.recognition import COAST_S
from tests.perception.target.walkers import (
    CLOTHES,
    RATE_HZ,
    SIMILAR,
    Walker,
    along,
    follow,
    followed,
    looking,
    moving,
    sights,
    states,
    steady,
)

TRACKED, COASTING, REACQUIRED, LOST = (
    TargetState.TRACKED,
    TargetState.COASTING,
    TargetState.REACQUIRED,
    TargetState.LOST,
)


def test_who_walks_alone_is_tracked_in_every_picture():
    said = follow([Walker("red", moving(60, 80))], 4)
    assert set(states(said)) == {TRACKED}
    assert min(answer.likeness for _, answer in said) > 0.9


def test_two_who_cross_keep_their_own_boxes_though_one_is_hidden_for_half_a_second():
    walkers = [Walker("red", moving(120, 40)), Walker("green", moving(280, -40))]
    said = follow(walkers, 5)
    hidden = sum(0 not in sight.who for sight, _ in said)
    assert hidden == pytest.approx(0.5 * RATE_HZ, abs=1)
    assert set(followed(said)) == {0, None}
    assert states(said).count(COASTING) <= hidden + 2
    assert LOST not in states(said)
    assert states(said)[-1] is TRACKED


def test_two_in_the_same_clothes_who_cross_are_told_apart_by_where_they_go():
    walkers = [Walker("red", moving(120, 80)), Walker("red", moving(360, -80), tall=110)]
    said = follow(walkers, 3)
    assert followed(said)[-1] == 0


def test_hidden_for_three_seconds_the_target_is_lost_and_comes_back_as_the_same_person():
    walkers = [
        Walker("red", along((0, 1), (100, 200))),
        Walker("green", along((0, 1, 4, 6), (330, 200, 200, 420))),
    ]
    said = follow(walkers, 7)
    assert sum(0 not in sight.who for sight, _ in said) > 3 * RATE_HZ
    assert [state for state, _ in itertools.groupby(states(said))] == [
        TRACKED,
        COASTING,
        LOST,
        REACQUIRED,
        TRACKED,
    ]
    assert set(followed(said)) == {0, None}
    assert states(said).count(REACQUIRED) == 1


def test_the_target_coasts_for_a_second_and_is_lost_after():
    said = follow([Walker("red", steady(200), here=lambda t_s: t_s < 0.98)], 4)
    unseen_s = [sight.t_ns / 1e9 - 7 - 0.95 for sight, _ in said]
    for out_s, state in zip(unseen_s, states(said), strict=True):
        if abs(out_s - COAST_S) > 0.01:
            assert state is (TRACKED if out_s < 0.01 else COASTING if out_s < COAST_S else LOST)


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


def test_a_target_that_goes_on_under_the_track_of_whom_it_crossed_is_taken_back_after_a_while():
    """Tracks are swapped when two cross: what seems to have hidden the target is the target."""

    def at(*lefts):
        return np.array([(left, 20, left + 40, 120) for left in lefts], np.float32)

    own, stranger = looking([0]), looking([2])
    both = np.concatenate((own, stranger))
    pictures = [
        *[(at(100, 170), both)] * 15,
        *[(at(100, left), both) for left in range(170, 114, -5)],
        *[(at(115), stranger)] * 25,
        *[(at(115), _mixture(share)) for share in np.linspace(1, 0, 60)],
        *[(at(115), own)] * 80,
    ]
    said = _said((at(100), own), pictures)
    assert said[120][0] is LOST
    assert said[-1] == (TRACKED, 0)


@pytest.mark.parametrize("doubtful", [False, True])
@pytest.mark.parametrize("other", [0.1, 0.4])
def test_a_box_that_may_be_of_who_stands_before_the_target_is_theirs_however_like_it_they_look(
    other, doubtful
):
    """For one picture both are in one box, which leads their track astray; then they look like the target."""

    def at(*lefts):
        return [(left, 57, left + 54, 207) for left in lefts]

    target, own, beside = (130, 60, 167, 171), looking([0]), np.concatenate((looking([0]), _mixture(other)))
    pictures = [
        *[([target, *at(left)], beside) for left in range(260, 150, -6)],
        ([(105, 45, 204, 219)], _mixture(other)),
        *[(at(left), own) for left in (*range(138, 118, -4), *range(118, 80, -6))],
        *[([target, *at(left)], beside) for left in range(80, -10, -6)],
    ]
    sure = [len(boxes) for boxes, _ in pictures]
    if doubtful:
        after = sure.index(1) + 1
        sure[after : after + 5] = [0] * 5
    said = _said(
        (np.array([target, *at(260)], np.float32), beside),
        [(np.array(boxes, np.float32), looks) for boxes, looks in pictures],
        sure=sure,
    )
    assert [place for _, place in said] == [0 if len(boxes) == 2 else None for boxes, _ in pictures]


def test_a_target_keeps_its_box_beside_somebody_who_is_missed():
    """They walk side by side, and its box is larger for the picture in which there is none on the other."""

    def at(left):
        return np.array([(100, 20, 140, 120), (left, 20, left + 40, 120)], np.float32)

    both, grown = np.concatenate((looking([0]), _mixture(0.1))), np.array([(97, 8, 143, 128)], np.float32)
    pictures = [
        *[(at(left), both) for left in range(160, 115, -3)],
        *[(at(115), both)] * 5,
        (grown, looking([0])),
        *[(at(115), both)] * 5,
    ]
    assert set(_said((at(160), both), pictures)) == {(TRACKED, 0)}


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
    said = _said((half, own), [*[(half, own)] * 20, *[two] * 3, *[(whole, own)] * 60])
    assert said[-1] == (TRACKED, 0)


def test_a_target_that_stood_beside_whom_the_lock_had_taken_for_it_is_taken_back():
    """The lock's mistake does not make the target a stranger: it still looks more like itself."""
    here, elsewhere = np.array([(100, 20, 140, 120)], np.float32), np.array([(200, 20, 240, 120)], np.float32)
    own = looking([0])
    alone, wrong = (here, own), (here, _mixture(0.4))
    both = np.vstack((here, elsewhere)), np.concatenate((_mixture(0.4), own))
    pictures = [wrong, *[both] * 15, *[(elsewhere, own)] * 40]
    said = _said(alone, pictures)
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
    facing = np.concatenate((own, _mixture(0.5), *passer))
    turned = np.concatenate((another_view, _mixture(0.35), *passer))
    said = _said((boxes, facing), [*[(boxes, facing)] * 40, *[(boxes, turned)] * 20])
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
    said = _said((both, _mixture(0.45)), _parting(2, 20))
    assert [place for _, place in said[:6]] == [0] * 6
    assert said[-1] == (TRACKED, 1)


def test_whoever_parts_from_the_target_much_later_is_somebody_else():
    both = np.array([(100, 20, 160, 120)], np.float32)
    said = _said((both, _mixture(0.45)), _parting(70, 20))
    assert said[-1] == (TRACKED, 0)


def test_whoever_comes_from_elsewhere_was_not_in_the_box_that_was_chosen():
    alone = np.array([(100, 20, 140, 120)], np.float32)
    beside = np.vstack((alone, alone + np.array([90, 0] * 2, np.float32)))
    looks = np.concatenate((looking([2]), looking([0])))
    said = _said((alone, _mixture(0.45)), [(alone, looking([2])), *[(beside, looks)] * 30])
    assert said[-1] == (TRACKED, 0)


def _mixture(share):
    """Return a look of which a share is not the target's: its likeness is the square root of the rest."""
    return np.sqrt((1 - share) * np.square(looking([0])) + share * np.square(looking([2])))


def _said(first, pictures, sure=None):
    """Return the lock's (state, index of the target's box) for each (boxes, looks), at 20 Hz; `sure` has for
    each how many of the boxes are surely people's, by default all."""
    lock = TargetLock()
    lock.choose(0, *first, 0)
    said = []
    for number, (boxes, looks) in enumerate(pictures, start=1):
        scores = np.full(len(boxes), 0.9, np.float32)
        surely = None if sure is None else sure[number - 1]
        answer = lock.update(boxes, scores, looks, STILL, number * 50_000_000, sure=surely)
        said.append((answer.state, answer.place))
    return said


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
    said = _said((here, looking([0])), [*pictures, *[nobody] * 40, *[(here, looking([kind]))] * 5])
    assert {state for state, _ in said[: len(pictures)]} == {TRACKED}
    assert said[-1] == (TRACKED, 0)


def test_no_view_is_kept_of_whom_somebody_has_just_crossed():
    """It may be somebody else by now."""
    here, half = np.array([(100, 20, 140, 120)], np.float32), _mixture(0.6)
    both = np.vstack((here, here + np.float32([20, 0, 20, 0]))), np.concatenate((half, looking([2])))
    alone, changed, nobody = (here, looking([0])), (here, half), (here[:0], looking([]))
    crossed = [*[both] * 10, *[changed] * 15, *[alone] * 120]
    said = _said(alone, [*[alone] * 60, *crossed, *[nobody] * 40, *[changed] * 20])
    assert {state for state, _ in said[: 60 + len(crossed)]} == {TRACKED}
    assert {state for state, _ in said[-20:]} == {LOST}


def test_nothing_is_learnt_of_a_target_that_is_half_covered():
    """Otherwise somebody who looks like a mix of both would later be taken for the target."""
    own, passers, half = looking([0]), looking([2]), _mixture(0.6)
    here = np.array([(100, 20, 140, 120)], np.float32)
    both = np.vstack((here, here + np.float32([20, 0, 20, 0])))
    alone, together = (here, own), (both, np.concatenate((half, passers)))
    nobody = here[:0], own[:0]
    said = _said(alone, [alone] * 60 + [together] * 100 + [nobody] * 30 + [(here, half)] * 20)
    assert {state for state, _ in said[:160]} == {TRACKED}
    assert {state for state, _ in said[-30:]} == {LOST}


def test_of_two_who_come_and_look_the_same_neither_is_taken():
    walkers = [
        Walker("red", steady(200), here=lambda t_s: t_s < 2),
        Walker("red", steady(150), here=lambda t_s: t_s >= 4),
        Walker("red", steady(250), here=lambda t_s: t_s >= 4),
    ]
    assert states(follow(walkers, 10))[-1] is LOST


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


def test_a_camera_that_pans_40_px_a_picture_changes_nothing():
    def pan(t_s):  # there and back, five pictures each
        number = round(t_s * RATE_HZ) % 10
        return 40 * min(number, 10 - number)

    walkers = [
        Walker("red", steady(place)) for place in (300, 340, 260)
    ]  # whoever jumps lands in a neighbour
    said = follow(walkers, 4, pan=pan)
    assert set(followed(said)) == {0}
    assert set(states(said)) == {TRACKED}


@pytest.mark.parametrize(
    ("measured", "along_with_it"),
    [
        (lambda t_s, motion: motion - 150 * (t_s == 1), False),
        (lambda t_s, motion: motion - 150 * (t_s == 1), True),
        (lambda t_s, motion: motion * (t_s != 1), True),
        (lambda t_s, motion: motion * (t_s >= 1), True),
    ],
    ids=["a stride on repeated tiles", "the same on the way", "unknown once", "unknown at first"],
)
def test_a_camera_whose_motion_is_measured_wrongly_or_not_at_all_loses_nobody(measured, along_with_it):
    """The robot stands, or turns as its target walks, 60 px a picture: in a picture the target stays."""
    speed = 60 * RATE_HZ * along_with_it
    walkers = [Walker("red with green trousers", moving(120, speed)), Walker("red", moving(200, speed))]
    said = follow(walkers, 2, target=1, pan=moving(0, speed), measured=measured)
    assert set(followed(said)) == {1}
    assert set(states(said)) == {TRACKED}


def test_a_turn_that_is_measured_late_gives_the_target_to_nobody_who_has_gone():
    """Until the turn is measured, all seem to walk with the picture; then whoever has gone is expected where
    the target is, and the target further on."""
    along_with_it = -40 * RATE_HZ
    walkers = [
        Walker("red with green trousers", moving(160, along_with_it), here=lambda t_s: t_s < 0.9),
        Walker("red", moving(200, along_with_it)),
    ]
    said = follow(
        walkers,
        1.5,
        target=1,
        pan=moving(0, along_with_it),
        measured=lambda t_s, motion: motion * (t_s >= 1),
    )
    assert set(followed(said)) == {1}
    assert set(states(said)) == {TRACKED}


def test_an_empty_picture_is_one_without_the_target():
    said = follow([Walker("red", steady(200), here=lambda t_s: t_s < 0.1 or 0.4 < t_s < 1)], 4)
    assert states(said)[-1] is LOST
    assert states(said)[round(0.3 * RATE_HZ)] is COASTING
    assert states(said)[round(0.7 * RATE_HZ)] is TRACKED


def test_nothing_can_be_kept_before_somebody_is_chosen():
    nobody = np.empty((0, 4), np.float32)
    with pytest.raises(RuntimeError, match="no target has been chosen"):
        TargetLock().update(nobody, np.empty(0, np.float32), np.empty((0, 3, 128), np.float32), STILL, 0)


def test_choosing_again_forgets_who_was_the_target():
    lock = TargetLock()
    scene = [Walker("red", steady(100)), Walker("green", steady(300))]
    ((sight, _),) = follow(scene, 0)
    looks = sight.looks, sight.motion
    lock.choose(0, sight.boxes, sight.looks, 0)
    lock.choose(1, sight.boxes, sight.looks, 0)
    assert lock.update(sight.boxes, sight.scores, *looks, 50_000_000).place == 1
