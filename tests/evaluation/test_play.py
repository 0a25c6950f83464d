"""Episodes come out the same whoever plays them, wherever, and next to whatever."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.evaluation import play as module
from adatracker_deploy.evaluation.play import Episode, play, play_all
from adatracker_deploy.learning.conditions import make_cell
from adatracker_deploy.learning.seeds import TUNING
from adatracker_deploy.policy.catalogue import load_policy
from adatracker_deploy.sim.episode import run_episode
from tests.evaluation import dying
from tests.policy import tiny

STEPS = 40
SEED = TUNING[0]


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tiny")
    tiny.Parts().write(folder)
    return str(folder)


def episode(policy, condition="field", seed=SEED, **changes):
    return Episode(policy=policy, spec=make_cell(condition, 1.7, 1.0, seed), steps=STEPS, **changes)


def same(ours, theirs):
    return (ours.ar, ours.el, ours.success) == (theirs.ar, theirs.el, theirs.success)


@pytest.mark.parametrize("name", ["pid", "bundle"])
def test_an_episode_is_what_the_in_process_loop_makes_of_it(name, bundle):
    """The tiny bundle answers yaw first, clockwise positive: order and signs must arrive."""
    policy = load_policy(bundle if name == "bundle" else name)
    asked = episode(name, condition="clean")
    body = asked.spec.embodiment
    wanted = run_episode(
        asked.spec.world(),
        body.body(),
        policy,
        body.limits(),
        steps=STEPS,
        rate_hz=10.0,
        seed=asked.spec.seed,
    )
    got = play(policy, asked)
    assert (got.ar, got.el) == (pytest.approx(wanted.ar), wanted.el)
    assert got.success == wanted.success


def test_processes_return_what_this_one_returns(bundle):
    episodes = [episode(policy, seed=SEED + n) for n in range(3) for policy in ("pid", bundle)]
    here, there = dict(play_all(episodes)), dict(play_all(episodes, workers=2))
    assert here.keys() == there.keys() == set(range(6))
    assert all(same(here[index], there[index]) for index in here)
    assert len({played.ar for played in here.values()}) == 6


def test_a_lost_target_ends_the_episode_without_success(bundle):
    long = replace(episode(bundle), steps=500)
    ((_, played),) = play_all([long])
    assert not played.success
    assert played.el < 500
    assert played.ar < played.floored_ar <= played.el


def test_contexts_are_kept_where_they_are_wanted(bundle):
    without, kept = (episode(bundle, with_contexts=wanted) for wanted in (False, True))
    (_, plain), (_, seen) = play_all([without, kept])
    assert plain.contexts is None
    assert seen.contexts.shape == (seen.el, tiny.CONTEXT)
    assert np.ptp(seen.contexts, axis=0).max() > 0
    assert same(plain, seen)


def test_an_imposed_context_answers_for_one_episode_only(bundle):
    z = np.array([0.9, -0.9, 0.9], np.float32)
    own = episode(bundle, with_contexts=True)
    imposed = replace(own, imposed=z)
    (_, before), (_, changed), (_, after) = play_all([own, imposed, own])
    np.testing.assert_array_equal(changed.contexts, np.tile(z, (changed.el, 1)))
    assert changed.ar != before.ar
    assert same(before, after)


def test_a_policy_without_context_has_none_to_study():
    with pytest.raises(UsageError, match="'pid' has no context encoder"):
        list(play_all([episode("pid", with_contexts=True)]))


def test_a_refusal_in_a_worker_is_the_same_refusal():
    with pytest.raises(UsageError, match="no/such: is not a policy bundle"):
        list(play_all([episode("no/such"), episode("no/such")], workers=2))


def test_a_worker_that_is_killed_is_told_in_one_line(monkeypatch):
    monkeypatch.setattr(module, "_work", dying.die)
    with pytest.raises(PlatformError, match="a worker process died"):
        list(play_all([episode("pid")], workers=2))
