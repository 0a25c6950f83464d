"""Takeovers end what is said of the policy, and are counted over the whole trial."""

from __future__ import annotations

from pathlib import Path

import pytest

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.record import BY_HAND, BY_POLICY
from adatracker_deploy.scoring.summary import statistics_of
from adatracker_deploy.scoring.summary_table import takeover_text
from adatracker_deploy.scoring.tally import Tally
from tests.trial.records import a_step, scored

ABOUT = {
    "platform": "drone",
    "policy": "pid",
    "reason": "",
    "steps": 100,
    "stop_s": None,
    "trial": Path("one"),
}


def ticks(drivers, metres=0.05, **changes):
    """A tick for each letter, p or h, every 0.05 s; the robot goes on by `metres` in each."""
    names = {"p": BY_POLICY, "h": BY_HAND, "-": None}
    return [
        a_step(n, driver=names[letter], pose=Pose(x=n * metres), **changes)
        for n, letter in enumerate(drivers)
    ]


def summary(steps, outcome="completed", **changes):
    found = Tally(steps).summary(**ABOUT | changes, outcome=outcome)
    assert found == Tally(map(scored, steps)).summary(**ABOUT | changes, outcome=outcome)  # as from a log
    return found


def test_two_takeovers_are_one_per_half_of_what_the_policy_drove():
    found = summary(ticks("p" * 40 + "h" * 20 + "p" * 60 + "h" * 10))["takeovers"]
    assert (found["count"], found["by_hand"]) == (2, 2)
    assert (found["policy_s"], found["hand_s"]) == pytest.approx((5.0, 1.45))
    assert (found["policy_m"], found["hand_m"]) == pytest.approx((5.0, 1.45))
    assert (found["between_s"], found["between_m"]) == pytest.approx((2.5, 2.5))


def test_a_takeover_is_the_policys_outcome_and_ends_its_mr_and_el():
    steps = ticks("p" * 30 + "h" * 20 + "p" * 30)
    alone, whole = summary(ticks("p" * 30)), summary(steps)
    assert (whole["outcome"], whole["el"]) == ("takeover", 29)
    assert whole["reason"] == "taken over by hand at step 30; the run ended as completed"
    assert whole["ended"] == {"outcome": "completed", "reason": ""}
    assert {key: whole[key] for key in ("mr", "el", "ar", "seconds", "latency_ms")} == {
        key: alone[key] for key in ("mr", "el", "ar", "seconds", "latency_ms")
    }
    assert (alone["outcome"], alone["takeovers"]["count"]) == ("completed", 0)


def test_a_pilots_takeover_counts_once_also_in_logs_that_say_nothing_of_a_driver():
    old = summary(ticks("-" * 21), "takeover")["takeovers"]
    assert (old["count"], old["by_hand"], old["between_s"]) == (1, 0, pytest.approx(1.0))
    assert summary(ticks("p" * 9 + "h" * 9), "takeover")["takeovers"]["count"] == 1  # from whom?
    assert summary(ticks("p" * 9 + "h" * 9 + "p" * 9), "takeover")["takeovers"]["count"] == 2


def test_by_hand_alone_a_trial_is_scored_whole_and_nobody_took_over():
    found = summary(ticks("h" * 30), policy="teleop")
    assert (found["outcome"], found["el"], found["mr"]) == ("completed", 29, 1.0)
    assert (found["takeovers"]["count"], found["takeovers"]["between_s"]) == (0, None)


def test_without_odometry_there_is_no_distance_and_a_broken_one_is_none():
    steps = [a_step(n, driver=BY_HAND if n > 5 else BY_POLICY, pose=None) for n in range(9)]
    found = summary(steps)["takeovers"]
    assert (found["policy_m"], found["between_m"]) == (None, None)
    assert found["between_s"] == pytest.approx(0.3)
    broken = summary(ticks("p" * 5, metres=float("nan")))["takeovers"]
    assert broken["policy_m"] is None


def test_of_several_trials_the_rate_is_that_of_the_sums():
    rows = [summary(ticks("p" * 21)), summary(ticks("p" * 41 + "h" * 5)), summary(ticks("p" * 11 + "h"))]
    found = statistics_of(rows)["takeovers"]
    assert found["count"] == 2
    assert found["policy_s"] == pytest.approx(1.0 + 2.05 + 0.55)
    assert found["between_s"] == pytest.approx(3.6 / 2)
    assert takeover_text(found) == (
        "2 takeovers (2 by hand) in 3.6 s and 3.6 m, one per 1.8 s and 1.8 m of the policy's driving; "
        "by hand 0.2 s"
    )
    assert statistics_of([])["takeovers"] is None


def picked(picks, **changes):
    """A tick for each number of choices so far; None: nobody has clicked."""
    return [a_step(n, picks=count, **changes) for n, count in enumerate(picks)]


def test_another_choice_of_the_operators_ends_what_is_said_of_the_policy():
    steps = [*picked([None] * 20), *(a_step(20 + n, picks=1, box=None) for n in range(10))]
    found = summary(steps)
    assert (found["outcome"], found["el"], found["mr"]) == ("takeover", 19, 1.0)
    assert found["reason"] == "the operator chose another target at step 20; the run ended as completed"
    assert found["ended"] == {"outcome": "completed", "reason": ""}
    assert (found["chosen_again"], found["takeovers"]["count"]) == (1, 0)  # nobody took over the driving


def test_every_other_choice_is_counted_and_those_before_the_first_tick_are_not():
    assert summary(picked([2] * 10))["outcome"] == "completed"
    assert summary(picked([2] * 10))["chosen_again"] == 0
    found = summary(picked([2, 2, 3, 3, 5]))
    assert (found["outcome"], found["el"], found["chosen_again"]) == ("takeover", 1, 3)


def test_a_click_that_changed_nothing_leaves_the_score_alone():
    assert summary(picked([None, None, 0, 0]))["outcome"] == "completed"
