"""A log holds what a policy was shown to the bit: asked again, it answers the same to the bit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from adatracker_deploy.core.messages import Action
from adatracker_deploy.core.record import Latency
from adatracker_deploy.policy.bundle import load_bundle
from adatracker_deploy.policy.onnx_policy import OnnxPolicy
from adatracker_deploy.policy.pid import PidPolicy
from adatracker_deploy.replay.answers import Gap, answer_again
from adatracker_deploy.replay.compare import Difference, first_difference
from adatracker_deploy.trial.reader import LoggedMask, read_trial
from adatracker_deploy.trial.step_json import step_from_json, step_to_json
from tests.policy import tiny
from tests.replay.trials import SEED, logged, observations
from tests.trial.records import a_step


@pytest.fixture(scope="module", params=["streaming", "window", "none"])
def policy(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("bundle")
    tiny.Parts(request.param).write(folder)
    return OnnxPolicy(load_bundle(folder))


def again(folder, policy):
    trial = read_trial(folder)
    return answer_again(trial.steps, trial.masks(), policy, SEED)


def test_every_answer_is_the_same_to_the_bit(policy, tmp_path):
    found = again(logged(tmp_path, policy, observations(40, gone={7, 8})), policy)
    assert (len(found.answers), found.idle, found.gap) == (40, 0, None)
    assert first_difference(found.answers) is None


def test_it_holds_for_a_policy_that_looks_at_boxes_and_times(tmp_path):
    found = again(logged(tmp_path, PidPolicy(), observations(40, gone={0, 20, 21})), PidPolicy())
    assert len({answer.action for answer in found.answers}) > 30
    assert first_difference(found.answers) is None


def test_ticks_that_nobody_was_asked_at_are_not_asked_again(policy, tmp_path):
    found = again(logged(tmp_path, policy, observations(20), stale={0, 5, 6}), policy)
    assert [answer.step.step for answer in found.answers] == [n for n in range(20) if n not in (0, 5, 6)]
    assert (found.idle, found.gap, first_difference(found.answers)) == (3, None, None)


def test_a_frame_that_several_ticks_acted_on_is_shown_each_time(policy, tmp_path):
    seen = [one for one in observations(8) for _ in range(3)]
    found = again(logged(tmp_path, policy, seen), policy)
    assert len(found.answers) == 24
    assert first_difference(found.answers) is None


@pytest.mark.parametrize(
    ("lacking", "gap"),
    [
        ({"missing": {12}}, Gap(12, "the log lacks this tick")),
        ({"unpictured": {9}}, Gap(9, "the log lacks the mask of this tick's frame")),
        ({"unpictured": {9}, "stale": {9}}, None),  # nobody was shown it
        ({"missing": {0}}, Gap(0, "the log lacks this tick")),
        ({"unpictured": {19}}, Gap(19, "the log lacks the mask of this tick's frame")),
    ],
)
def test_from_a_gap_on_nothing_is_compared(tmp_path, lacking, gap):
    found = again(logged(tmp_path, PidPolicy(), observations(20), **lacking), PidPolicy())
    assert found.gap == gap
    last = gap.step if gap else 20
    assert len(found.answers) == last - len([n for n in lacking.get("stale", ()) if n < last])
    assert first_difference(found.answers) is None


def test_another_reset_is_another_policy_where_a_colour_is_drawn(policy, tmp_path):
    trial = read_trial(logged(tmp_path, policy, observations(5)))
    found = answer_again(trial.steps, trial.masks(), policy, SEED + 1)
    assert first_difference(found.answers) is not None


FLOATS = st.floats(width=32)


class Parrot:
    """Answers what it is told."""

    def __init__(self, action, context):
        self._answer = Action(np.array(action, np.float32), np.array(context, np.float32))

    def reset(self, seed=0):
        pass

    def act(self, observation):
        return self._answer


def answered(action, context, said, z):
    """One tick's logged action and z, through the log's own text, beside what is said now."""
    step = step_from_json(step_to_json(a_step(0, action=tuple(action), context=tuple(context))))
    mask = LoggedMask(0, np.zeros((2, 2), np.uint8))
    return answer_again([step], iter([mask]), Parrot(said, z), 0).answers


@given(action=st.lists(FLOATS, min_size=1, max_size=4), context=st.lists(FLOATS, max_size=4))
def test_any_number_survives_the_log_to_the_bit(action, context):
    assert first_difference(answered(action, context, action, context)) is None


@given(action=st.lists(FLOATS, min_size=1, max_size=4), data=st.data())
def test_a_single_bit_is_a_difference(action, data):
    place = data.draw(st.integers(0, len(action) - 1))
    bit = data.draw(st.integers(0, 31))
    other = np.array(action, np.float32)
    other.view(np.uint32)[place] ^= np.uint32(1) << np.uint32(bit)
    found = first_difference(answered(action, (), other, ()))
    if np.isnan(action[place]) and np.isnan(other[place]):
        assert found is None  # text knows but one NaN
        return
    assert isinstance(found, Difference)
    assert (found.step, found.what, found.place) == (0, "action", place)
    assert "tick 0, action" in found.words


def test_more_or_fewer_numbers_are_a_difference():
    found = first_difference(answered((0.5,), (), (0.5, 0.5), ()))
    assert found.words == "tick 0, action: 2 numbers, in the log 1"


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(t_ns=st.integers(0, 2**62), age_ns=st.integers(-(10**9), 26 * 24 * 3600 * 10**9))
def test_a_frames_time_is_known_to_the_nanosecond(t_ns, age_ns):
    latency = Latency(
        observation_age_ms=(t_ns - (t_ns - age_ns)) / 1e6, infer_ms=0, sensor_to_command_ms=0, lateness_ms=0
    )
    step = step_from_json(step_to_json(a_step(0, t_ns=t_ns, latency=latency)))
    assert step.frame_t_ns == t_ns - age_ns
