"""Episodes to learn from: consecutive ticks alone, with what was sent and what came of it."""

from __future__ import annotations

import pytest

from adatracker_deploy.core.messages import ZERO, Box, Twist
from adatracker_deploy.core.task import box_reward
from adatracker_deploy.scoring.metrics import Scorer
from adatracker_deploy.trial.ending import ending
from adatracker_deploy.trial.episodes import episodes, tick_rate_hz
from adatracker_deploy.trial.marks import Mark, add_mark
from adatracker_deploy.trial.reader import read_trial
from tests.trial.records import REFERENCE, TICK_NS, a_step, a_trial

AWAY = Box(0.7, 0.5, 0.2, 0.4)


def ticks_of(found):
    return [[one.tick.step for one in episode] for episode in found]


def test_a_whole_trial_is_one_episode_and_its_last_tick_only_shows_what_came_of_it():
    steps = [a_step(0), a_step(1, box=AWAY), a_step(2, box=None), a_step(3)]
    (episode,) = episodes(steps, "completed", range(4))
    assert ticks_of([episode]) == [[0, 1, 2]]
    assert [one.reward for one in episode] == [box_reward(AWAY, REFERENCE), 0.0, 1.0]
    assert [one.seen for one in episode] == [True, False, True]
    assert not any(one.done for one in episode)


def test_the_mean_reward_of_a_whole_trial_is_its_mr():
    boxes = [REFERENCE, AWAY, None, Box(0.4, 0.6, 0.1, 0.3), Box(0.5, 0.5, 0.0, 0.4), REFERENCE]
    steps = [a_step(number, box=box) for number, box in enumerate(boxes)]
    (episode,) = episodes(steps, "completed", range(6))
    scorer = Scorer()
    for step in steps:
        scorer.add_step(step)
    assert sum(one.reward for one in episode) / len(episode) == pytest.approx(scorer.score().mr)


@pytest.mark.parametrize(
    "gap",
    [
        {3: {"stale": True}},
        {number: {"missed_deadlines": 1} for number in (4, 5, 6)},
        {3: {"frame_seq": 99}},
    ],
    ids=["a stale tick", "a missed slot", "a frame that the log lacks"],
)
def test_a_gap_ends_an_episode_and_nothing_reaches_across_it(gap):
    steps = [a_step(number, **gap.get(number, {})) for number in range(7)]
    found = episodes(steps, "completed", range(7))
    assert [episode[0].tick.step for episode in found] == [0, 4]
    for episode in found:
        numbers = [one.tick.step for one in episode]
        assert numbers == list(range(numbers[0], numbers[-1] + 1))
        assert not any(one.tick.stale for one in episode)


def test_a_tick_that_the_log_lacks_is_a_gap():
    steps = [a_step(number) for number in (0, 1, 2, 4, 5)]
    assert ticks_of(episodes(steps, "completed", range(6))) == [[0, 1], [4]]


def test_a_command_that_was_never_sent_left_the_robot_with_the_last_one():
    steps = [a_step(0, sent=None), a_step(1, sent=Twist(vx=0.3)), a_step(2, sent=None), a_step(3)]
    (episode,) = episodes(steps, "completed", range(4))
    assert [one.sent for one in episode] == [ZERO, Twist(vx=0.3), Twist(vx=0.3)]


@pytest.mark.parametrize(("outcome", "done"), [("lost", True), ("collision", True), ("takeover", False)])
def test_only_the_tasks_own_end_is_done(outcome, done):
    (episode,) = episodes([a_step(number) for number in range(4)], outcome, range(4))
    assert [one.done for one in episode] == [False, False, done]


def test_a_trial_is_cut_where_the_operator_said_that_it_ended(tmp_path):
    folder = a_trial(tmp_path, [a_step(number) for number in range(6)])
    mark = Mark(at="2026-01-01T12:00:00+00:00", outcome="wrong_person", since_s=3 * TICK_NS / 1e9)
    add_mark(folder / "trial.mcap", mark)
    ended = ending(read_trial(folder))
    assert (ended.outcome, ended.ticks) == ("wrong_person", 4)


def test_the_rate_is_that_of_most_ticks():
    late = [a_step(number, t_ns=number * TICK_NS + (number == 3) * 9_000_000) for number in range(9)]
    assert tick_rate_hz(late) == pytest.approx(20.0)
    assert tick_rate_hz(late[:1]) is None
