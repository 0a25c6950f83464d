"""The lock keeps one person, seen or for a moment not, through a camera's turns."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from adatracker_deploy.core.messages import TargetState
from adatracker_deploy.perception.target.lock import TargetLock
from adatracker_deploy.perception.target.motion import STILL
from adatracker_deploy.perception.target.recognition import COAST_S
from tests.perception.target.walkers import (
    RATE_HZ,
    Walker,
    along,
    follow,
    followed,
    moving,
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
