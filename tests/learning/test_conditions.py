"""The grid is the paper's, cells repeat, and each condition is what its name says."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.learning.conditions import (
    CONDITIONS,
    HEIGHTS_M,
    TARGET_SPEEDS_M_S,
    YAW_RATE_RAD_S,
    make_cell,
    random_cell,
)
from adatracker_deploy.learning.data.recipe import load_recipe
from adatracker_deploy.learning.seeds import FIRST_EVALUATION, TRAINING, TUNING, training_seed
from adatracker_deploy.learning.tracking import Tracking

CELLS = [(height, speed) for height in HEIGHTS_M for speed in TARGET_SPEEDS_M_S]


@pytest.mark.parametrize(("height", "speed"), CELLS)
def test_the_trackers_limit_is_1_3_times_the_targets_speed_and_at_least_1(height, speed):
    body = make_cell("clean", height, speed, 900_000).embodiment
    assert body.forward_m_s == pytest.approx(max(1.0, 1.3 * speed))
    assert (body.height_m, body.fov_deg, body.pitch_deg, body.lag_s, body.delay_s) == (height, 90, 0, 0, 0)


@settings(max_examples=100)
@given(seed=st.integers(0, 2_000_000), cell=st.sampled_from(CELLS))
def test_a_field_body_is_within_the_conditions_ranges(seed, cell):
    spec = make_cell("field", *cell, seed)
    body = spec.embodiment
    assert 0.1 <= body.lag_s <= 0.4
    assert body.delay_s in (0.0, 0.1, 0.2)
    assert 70 <= body.fov_deg <= 100
    assert (spec.obstacles, spec.others, spec.noise) == (True, 2, "field")
    assert spec == make_cell("field", *cell, seed)


@settings(max_examples=100)
@given(seed=st.integers(0, 2_000_000))
def test_every_hard_body_is_slower_to_obey_than_any_that_the_deploy_recipe_draws(seed):
    hard, trained = random_cell("hard", seed).embodiment, load_recipe("deploy").draw(seed).embodiment
    assert hard.lag_s + hard.delay_s >= 0.5
    assert trained.lag_s <= 0.5
    assert trained.delay_s <= 0.3


@settings(max_examples=100)
@given(seed=st.integers(0, 2_000_000), cell=st.sampled_from(CELLS))
def test_a_wide_body_can_follow_its_target_before_and_after_its_change(seed, cell):
    spec = make_cell("wide", *cell, seed)
    body, after = spec.embodiment, spec.change.of(spec.embodiment)
    assert 150 <= spec.change.at_step <= 350
    assert body.forward_m_s >= after.forward_m_s >= 1.04 * spec.target_speed_m_s - 1e-9
    assert 0.3 * body.forward_m_s <= body.backward_m_s <= body.forward_m_s
    assert 0 <= body.lag_s <= after.lag_s <= 1.4
    assert body.delay_s <= 0.6
    assert 0.5 <= body.yaw_rate_rad_s / YAW_RATE_RAD_S <= 2


def test_wide_bodies_span_the_conditions_ranges():
    bodies = [random_cell("wide", seed).embodiment for seed in range(300)]
    assert {round(body.delay_s * 10) for body in bodies} == set(range(7))
    assert min(body.lag_s for body in bodies) < 0.05
    assert max(body.lag_s for body in bodies) > 0.95


@pytest.mark.parametrize("condition", CONDITIONS)
@pytest.mark.parametrize(("height", "speed"), CELLS)
def test_the_target_is_seen_at_the_start_of_every_cell(condition, height, speed):
    first = Tracking(make_cell(condition, height, speed, 900_001)).begin()
    assert (first.mask == MaskClass.TARGET).sum() >= 8


def test_rough_is_the_field_with_effects_and_has_the_same_bodies_and_ways():
    field, rough = (make_cell(name, 1.0, 1.0, 5) for name in ("field", "rough"))
    assert replace(rough, effects=field.effects) == field
    assert rough.effects.fog_m
    assert rough.effects.road != "smooth"
    assert rough.effects.sit


def test_an_unknown_condition_is_refused_with_the_known_ones():
    with pytest.raises(
        UsageError, match="unknown condition 'wet': known are clean, field, hard, wide, rough"
    ):
        make_cell("wet", 1.0, 1.0, 0)


@given(run=st.integers(0, 1000), shard=st.integers(0, 1 << 21), episode=st.integers(0, 1000))
def test_training_tuning_and_evaluation_seeds_never_meet(run, shard, episode):
    seed = training_seed(run, shard, episode)
    assert seed in TRAINING
    assert TRAINING.stop <= TUNING.start
    assert TUNING.stop <= FIRST_EVALUATION
