"""The metrics against pencil and paper, and what must hold for any trial."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.messages import Box
from adatracker_deploy.core.task import MAX_LOST_STEPS, box_reward, step_reward, target_visible
from adatracker_deploy.scoring.metrics import DEFAULT_RULES, Rules, Scorer, score_boxes
from tests.trial.records import REFERENCE, a_step

fraction = st.floats(0, 1)
size = st.floats(0.001, 1)
boxes = st.builds(Box, fraction, fraction, size, size)
short_trials = st.lists(st.none() | boxes, max_size=MAX_LOST_STEPS)
"""Too short to end by the rule of lost steps."""


def score_steps(steps, rules=DEFAULT_RULES):
    scorer = Scorer(rules)
    for step in steps:
        scorer.add_step(step)
    return scorer.score()


def test_a_perfect_trial_scores_one_and_not_more():
    score = score_boxes([REFERENCE] * 101)
    assert (score.mr, score.mr_visible, score.visibility, score.el) == (1.0, 1.0, 1.0, 100)


def test_r_is_one_over_one_plus_the_two_distances():
    moved = Box(0.5 + 0.3, 0.5 - 0.4, 0.2, 0.4)
    grown = Box(0.5, 0.5, 0.2 + 0.06, 0.4 + 0.08)
    both = Box(0.5 + 0.3, 0.5 - 0.4, 0.2 + 0.06, 0.4 + 0.08)
    assert box_reward(moved, REFERENCE) == pytest.approx(1 / 1.5)
    assert box_reward(grown, REFERENCE) == pytest.approx(1 / 1.1)
    assert box_reward(both, REFERENCE) == pytest.approx(1 / 1.6)


def test_lost_steps_count_as_zero_and_are_told_beside():
    moved = Box(0.8, 0.9, 0.2, 0.4)  # R = 2/3
    score = score_boxes([REFERENCE, moved, None, REFERENCE, None])
    assert score.mr == pytest.approx((2 / 3 + 0 + 1 + 0) / 4)
    assert score.mr_visible == pytest.approx((2 / 3 + 1) / 2)
    assert score.visibility == 0.5
    assert not score.lost


def test_ticks_before_the_first_box_count_as_lost():
    score = score_boxes([None, None, REFERENCE, REFERENCE])
    assert score.mr == pytest.approx(1 / 3)
    assert score.el == 3


@pytest.mark.parametrize("ticks", [0, 1])
def test_a_trial_that_ended_before_its_first_step_scores_zero(ticks):
    score = score_boxes([REFERENCE] * ticks)
    assert (score.mr, score.mr_visible, score.visibility, score.el) == (0.0, None, 0.0, 0)


def test_the_fiftieth_lost_step_in_a_row_ends_the_trial_and_what_follows_does_not_count():
    score = score_boxes([REFERENCE] * 11 + [None] * 50 + [REFERENCE] * 1000)
    assert score.lost
    assert score.el == 60
    assert score.mr == pytest.approx(10 / 60)
    assert score.mr_visible == 1.0


def test_forty_nine_lost_steps_do_not_end_it():
    score = score_boxes([REFERENCE] * 11 + [None] * 49 + [REFERENCE])
    assert not score.lost
    assert score.el == 60


def test_the_published_simulator_needs_one_lost_step_more():
    fifty_lost = [REFERENCE, *[None] * 50]
    assert score_boxes(fifty_lost).lost
    assert not score_boxes(fifty_lost, Rules(max_lost_steps=51)).lost


@pytest.mark.parametrize(
    ("distance_m", "bearing_deg", "reward"),
    [(2.5, 0, 1.0), (10.0, 0, 0.0), (2.5, 45, 0.0), (2.5, -45, 0.0), (0.0, 0, 2 / 3), (6.25, 22.5, 0.0)],
)
def test_the_reward_falls_with_distance_and_bearing(distance_m, bearing_deg, reward):
    assert step_reward(distance_m, math.radians(bearing_deg)) == pytest.approx(reward)


def test_ar_sums_the_reward_of_every_step_but_the_first_tick():
    steps = [a_step(0), a_step(1), a_step(2, distance_m=10.0), a_step(3, bearing_rad=math.pi, box=None)]
    assert score_steps(steps).ar == pytest.approx(1 + 0 + (1 - 4))


def test_ar_is_unknown_without_truth():
    steps = [a_step(step, distance_m=None, bearing_rad=None) for step in range(3)]
    assert score_steps(steps).ar is None


def test_a_tick_that_the_log_dropped_still_counts_in_the_episode_length():
    assert score_steps([a_step(step) for step in (0, 1, 2, 5)]).el == 5


def test_visible_means_in_the_mask_within_ninety_degrees_and_seven_and_a_half_metres():
    edge = math.radians(45)
    assert target_visible(7.5, edge, in_mask=True)
    assert target_visible(7.5, -edge, in_mask=True)
    assert not target_visible(7.51, 0.0, in_mask=True)
    assert not target_visible(2.5, edge + 0.01, in_mask=True)
    assert not target_visible(2.5, 0.0, in_mask=False)


def test_the_papers_printed_sum_counts_the_reference_and_so_exceeds_one():
    printed = Rules(count_reference=True)
    assert score_boxes([REFERENCE] * 11, printed).mr == pytest.approx(11 / 10)
    moved = Box(0.8, 0.9, 0.2, 0.4)  # R = 2/3
    assert score_boxes([REFERENCE, moved, None], printed).mr == pytest.approx((1 + 2 / 3 + 0) / 2)
    assert score_boxes([REFERENCE, moved, None], printed).mr_visible == pytest.approx(2 / 3)
    assert score_boxes([None, None, None], printed).mr == 0


def test_the_simulators_code_lets_no_reward_fall_below_minus_one():
    steps = [a_step(0), a_step(1), a_step(2, bearing_rad=math.pi)]
    assert score_steps(steps).ar == pytest.approx(1 + (1 - 4))
    assert score_steps(steps, Rules(least_reward=-1.0)).ar == pytest.approx(1 - 1)


@pytest.mark.parametrize(
    "bad",
    [Box(math.nan, 0.5, 0.2, 0.4), Box(0.5, math.inf, 0.2, 0.4), Box(0.5, 0.5, -0.2, 0.4), Box(0, 0, 0, 0)],
)
def test_a_box_that_is_none_counts_as_lost_and_is_told(bad):
    score = score_boxes([bad, REFERENCE, REFERENCE, bad, None, REFERENCE])
    assert score.bad_boxes == 2
    assert (score.mr, score.visibility, score.el) == (2 / 5, 2 / 5, 5)


def test_of_a_trial_that_ended_only_what_came_before_is_summed():
    steps = [a_step(step, box=REFERENCE if step < 3 else None) for step in range(80)]
    score = score_steps(steps, Rules(max_lost_steps=10))
    assert (score.lost, score.el, score.ticks) == (True, 12, 13)
    assert score.ar == pytest.approx(12)


@given(st.lists(st.none() | boxes, max_size=200))
def test_every_share_lies_between_nothing_and_all(trial):
    score = score_boxes(trial)
    assert 0 <= score.mr <= 1
    assert 0 <= score.visibility <= 1
    assert score.mr <= (score.mr_visible or 0.0) + 1e-12


@given(short_trials, boxes, st.data())
def test_losing_one_step_more_never_raises_mr(trial, first, data):
    trial = [first, *trial][:MAX_LOST_STEPS]
    lost = data.draw(st.integers(1, len(trial))) if len(trial) > 1 else len(trial)
    worse = [None if tick == lost else box for tick, box in enumerate(trial)]
    assert score_boxes(worse).mr <= score_boxes(trial).mr + 1e-12


@given(st.lists(st.none() | boxes, min_size=1, max_size=120), boxes, st.data())
def test_losing_one_step_more_never_raises_the_sum_of_r_nor_the_length(trial, first, data):
    """MR itself may rise where the trial then ends sooner: it is a mean, to be read beside EL."""
    lost = data.draw(st.integers(1, len(trial)))
    trial = [first, *trial]
    before = score_boxes(trial, Rules(max_lost_steps=10))
    after = score_boxes(
        [None if tick == lost else box for tick, box in enumerate(trial)], Rules(max_lost_steps=10)
    )
    assert after.el <= before.el
    assert after.mr * after.el <= before.mr * before.el + 1e-9


@given(boxes, boxes)
def test_r_is_one_only_for_the_reference_itself_and_the_same_both_ways(one, other):
    assert box_reward(one, one) == 1.0
    assert 0 < box_reward(one, other) <= 1
    assert box_reward(one, other) == box_reward(other, one)


def test_stale_steps_are_no_measurement_neither_seen_nor_lost():
    scorer = Scorer()
    for step in (a_step(0), a_step(1, box=None), a_step(2, box=None, stale=True), a_step(3)):
        scorer.add_step(step)
    score = scorer.score()
    assert (score.mr, score.visibility, score.stale, score.el) == (0.5, 0.5, 1, 3)


def test_a_run_of_lost_steps_is_neither_ended_nor_lengthened_by_stale_ones():
    scorer = Scorer(Rules(max_lost_steps=3))
    for number, stale in enumerate((False, False, True, True, False)):
        scorer.add_step(a_step(number, box=None, stale=stale))
        assert scorer.lost == (number == 4)
    only_stale = Scorer(Rules(max_lost_steps=3))
    for number in range(9):
        only_stale.add_step(a_step(number, box=None, stale=True))
    assert not only_stale.lost
    assert only_stale.score().mr == 0.0
