"""Recipes are read strictly, and draw what they say."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.data.recipe import load_mixture, load_recipe, recipe_names
from adatracker_deploy.learning.episode_spec import RATE_HZ
from adatracker_deploy.learning.expert import DEFAULT_GAINS
from adatracker_deploy.sim.bodies import lag_share
from tests.learning.data import tiny


def test_the_paper_and_the_deploy_recipe_are_shipped():
    assert (
        " ".join(recipe_names())
        == "beyond broad calm calm-late deploy ground ground-late late offline paper robots tall wide"
    )
    assert load_recipe("paper").steps == 190_000
    assert load_recipe("deploy").steps == 1_000_000


@settings(max_examples=100)
@given(seed=st.integers(0, 899_999))
def test_the_papers_bodies_have_its_heights_and_limits(seed):
    spec = load_recipe("paper").draw(seed)
    assert spec.embodiment.height_m in (0.5, 1.0, 1.7)
    assert 0.8 <= spec.embodiment.forward_m_s <= 1.5
    assert spec.embodiment.forward_m_s / spec.target_speed_m_s == pytest.approx(1.3, abs=0.01)
    assert (spec.scene, spec.obstacles, spec.others, spec.noise) == ("simple_room", False, 0, "none")


@settings(max_examples=200)
@given(seed=st.integers(0, 899_999))
def test_a_deploy_body_is_faster_than_whom_it_follows_and_repeats_by_seed(seed):
    recipe = load_recipe("deploy")
    spec = recipe.draw(seed)
    body = spec.embodiment
    assert spec == recipe.draw(seed)
    assert 0.2 <= body.height_m <= 3.5
    assert body.forward_m_s <= 5.0
    assert spec.target_speed_m_s <= 0.88 * body.forward_m_s
    assert spec.crossing <= spec.others


def test_the_deploy_recipe_spans_the_papers_grid():
    recipe = load_recipe("deploy")
    specs = [recipe.draw(seed) for seed in range(2000)]
    heights = np.array([spec.embodiment.height_m for spec in specs])
    speeds = np.array([spec.target_speed_m_s for spec in specs])
    for low, high in ((0.2, 0.4), (0.9, 1.1), (1.6, 1.8), (2.8, 3.2)):
        assert ((heights > low) & (heights < high)).mean() > 0.03
    for low, high in ((0.3, 0.7), (0.8, 1.2), (1.8, 2.2), (2.7, 3.2)):
        assert ((speeds > low) & (speeds < high)).mean() > 0.01


def test_a_share_of_change_changes_so_many_bodies_and_nothing_else():
    plain, some = tiny.recipe(), tiny.recipe(change=0.5)
    drawn = [(plain.draw(seed), some.draw(seed)) for seed in range(200)]
    assert 70 <= sum(spec.change is not None for _, spec in drawn) <= 130
    for without, spec in drawn:
        assert replace(spec, change=None) == without
        assert spec.change is None or 12 <= spec.change.at_step <= 28


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"hight_m": {"one_of": [1]}}, "tiny: unknown key 'hight_m'; did you mean 'height_m'?"),
        ({"steps": 0}, "tiny: steps: 0 is out of range"),
        ({"height_m": 1.0}, "tiny: height_m: expected a mapping"),
        ({"height_m": {"low": 2.0, "high": 1.0}}, "low 2 is above high 1"),
        ({"height_m": {"one_of": []}}, "one_of is empty"),
        ({"noise": {"loud": 1}}, "tiny: noise: unknown choice 'loud'; known are none, field, hard"),
        ({"kinds": {"differential": 0}}, "tiny: kinds: needs at least one choice with a weight above 0"),
        ({"scenes": {"moon": 1}}, "tiny: scenes: unknown choice 'moon'"),
        ({"aspect": {"one_of": [0.75, 2]}}, "tiny: aspect: 2 is out of range [0.25, 1]"),
        ({"fov_deg": {"low": 60, "high": 200}}, "tiny: fov_deg: 200 is out of range [20, 150]"),
        ({"lag_s": {"low": -0.1, "high": 1}}, "tiny: lag_s: -0.1 is out of range [0, 2]"),
    ],
)
def test_a_wrong_recipe_is_one_clear_line(changed, message):
    with pytest.raises(UsageError) as refused:
        tiny.recipe(**changed)
    assert message in str(refused.value)
    assert str(refused.value).startswith("tiny")
    assert "\n" not in str(refused.value)


def test_a_missing_or_broken_file_is_one_clear_line(tmp_path):
    with pytest.raises(
        UsageError, match="unknown recipe 'soup': known are beyond, broad, calm, calm-late, deploy"
    ):
        load_recipe("soup")
    with pytest.raises(UsageError, match="cannot be read"):
        load_recipe(str(tmp_path / "none.yaml"))
    broken = tmp_path / "broken.yaml"
    broken.write_text("steps: [")
    with pytest.raises(UsageError, match="not valid YAML"):
        load_recipe(str(broken))


def test_a_mixture_draws_each_episode_from_one_of_its_recipes_each_as_likely():
    mixed = load_mixture("calm+ground+calm")
    calm, ground = load_recipe("calm"), load_recipe("ground")
    assert (mixed.episode_steps, mixed.expert) == (ground.episode_steps, ground.expert)
    drawn = [mixed.draw(seed) for seed in range(300)]
    from_calm = [spec == calm.draw(seed) for seed, spec in enumerate(drawn)]
    assert all(spec == ground.draw(seed) for seed, spec in enumerate(drawn) if not from_calm[seed])
    assert sum(from_calm) / 300 == pytest.approx(2 / 3, abs=0.08)
    assert load_mixture("calm") == calm


def test_a_file_may_have_a_plus_in_its_path(tmp_path):
    path = tmp_path / "wet+dry.yaml"
    path.write_text((files("adatracker_deploy.learning") / "recipes" / "calm.yaml").read_text())
    assert load_mixture(str(path)) == replace(load_recipe("calm"), name="wet+dry")


@pytest.mark.parametrize(
    ("names", "reason"), [("calm+soup", "unknown recipe 'soup'"), ("calm+offline", "their experts differ")]
)
def test_a_mixture_that_makes_no_sense_is_one_clear_line(names, reason):
    with pytest.raises(UsageError, match=reason):
        load_mixture(names)


def test_the_offline_recipes_expert_can_be_cloned_without_knowing_the_lag():
    """It feeds the body's velocity back less than once, on any of the recipe's bodies."""
    recipe = load_recipe("offline")
    assert recipe.expert.lead * (1 / lag_share(recipe.lag_s.high, 1 / RATE_HZ) - 1) < 1
    deploy = load_recipe("deploy")
    assert recipe.height_m.high > deploy.height_m.high
    same = {"name": "", "description": "", "steps": 1, "expert": DEFAULT_GAINS, "height_m": deploy.height_m}
    assert replace(recipe, **same) == replace(deploy, **same)
