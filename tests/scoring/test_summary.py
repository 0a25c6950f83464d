"""The summaries of a trial and of a set of trials."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from adatracker_deploy.core.record import Latency
from adatracker_deploy.scoring.compare import compare
from adatracker_deploy.scoring.compare_view import comparison_table
from adatracker_deploy.scoring.latex import real_world_table
from adatracker_deploy.scoring.stages import STAGES
from adatracker_deploy.scoring.summary import summarise_set
from adatracker_deploy.scoring.summary_table import stage_table, summary_table
from adatracker_deploy.scoring.tally import Tally
from tests.trial.records import REFERENCE, TICK_NS, a_step

CONTRACT = {
    "platform", "policy", "outcome", "mr", "mr_visible", "visibility", "el", "ar", "steps", "rate_hz",
    "latency_ms", "missed_deadlines", "stop_s", "reason", "trial",
}  # fmt: skip


def a_summary(records=None, outcome="completed", steps=10, **changes):
    records = [a_step(step) for step in range(11)] if records is None else records
    about = {"platform": "drone", "policy": "pid", "reason": "", "stop_s": 0.5, "trial": Path("trials/one")}
    return Tally(records).summary(outcome=outcome, steps=steps, **(about | changes))


def drawn(summaries):
    console = Console(file=io.StringIO(), width=80)
    console.print(summary_table(summaries))
    return console.file.getvalue()


def test_a_trial_has_every_key_of_the_contract():
    assert set(a_summary()) >= CONTRACT


def test_a_run_that_ended_before_its_first_tick_has_them_too():
    summary = a_summary(records=[], outcome="system_fault")
    assert set(summary) >= CONTRACT
    assert (summary["mr"], summary["el"], summary["rate_hz"]) == (0.0, 0, None)
    assert summary["latency_ms"] == {"p50": None, "p99": None, "max": None}


def test_the_rate_is_that_of_the_runs_clock():
    assert a_summary()["rate_hz"] == pytest.approx(1e9 / TICK_NS)


def test_latency_is_from_sensor_to_command():
    def took(ms):
        return Latency(observation_age_ms=0, infer_ms=0, sensor_to_command_ms=ms, lateness_ms=0)

    records = [a_step(step, latency=took(10 + step)) for step in range(101)]
    latency = a_summary(records)["latency_ms"]
    assert (latency["p50"], latency["p99"], latency["max"]) == pytest.approx((60, 109, 110))


def a_traced_step(step, ms):
    """A step whose stages took ms, 2 ms, 3 ms, 4 ms, 5 ms, 6 ms on its way to the wire."""
    latency = Latency(
        observation_age_ms=ms + 5,
        infer_ms=4,
        sensor_to_command_ms=ms + 9,
        lateness_ms=0.5,
        capture_ms=ms,
        perceive_ms=2,
        gate_ms=5,
        send_ms=6,
        sensor_to_wire_ms=ms + 20,
    )
    return a_step(step, latency=latency)


def test_the_way_is_split_into_stages():
    summary = a_summary([a_traced_step(step, ms=10 + step) for step in range(101)])
    stages = summary["stages_ms"]
    assert list(stages) == list(STAGES)
    assert [stages[stage]["p50"] for stage in STAGES] == pytest.approx([60, 2, 3, 4, 5, 6, 80])
    assert stages["capture"] == pytest.approx({"p50": 60, "p99": 109, "max": 110})
    assert summary["lateness_ms"] == pytest.approx({"p50": 0.5, "p99": 0.5, "max": 0.5})


def test_stages_that_an_older_log_does_not_know_are_none():
    stages = a_summary()["stages_ms"]
    nothing = {"p50": None, "p99": None, "max": None}
    assert {name: found for name, found in stages.items() if found != nothing} == {
        "infer": {"p50": 2, "p99": 2, "max": 2}
    }


def test_several_trials_show_the_median_of_their_medians_and_the_worst_of_the_rest():
    trials = [a_summary([a_traced_step(step, ms=ms) for step in range(11)]) for ms in (1, 70, 8)]
    lines = drawn_stages(trials)
    assert lines["capture"].split()[-3:] == ["8.0", "70.0", "70.0"]
    assert lines["sensor to command"].split()[-3:] == ["17.0", "79.0", "79.0"]
    assert drawn_stages([a_summary()])["gate"].split()[-3:] == ["-", "-", "-"]


def drawn_stages(summaries):
    console = Console(file=io.StringIO(), width=80)
    console.print(stage_table(summaries))
    names = (*(stage.replace("_", " ") for stage in STAGES), "sensor to command", "lateness")
    lines = console.file.getvalue().splitlines()
    return {name: next(line for line in lines if line.strip().startswith(name)) for name in names}


def test_mean_and_std_over_trials_are_the_papers():
    short = a_summary([a_step(step) for step in range(7)], outcome="lost")
    together = summarise_set([a_summary(), short])
    assert together["trials"] == [a_summary(), short]
    assert together["mean"]["el"] == 8.0
    assert together["std"]["el"] == pytest.approx(8**0.5)  # of a sample: ((10 - 8)^2 + (6 - 8)^2) / (2 - 1)
    assert together["mean"]["sr"] == 0.5


def test_each_platform_has_its_own_mean_where_there_are_several():
    short = a_summary([a_step(step) for step in range(7)], outcome="lost", platform="wheeled")
    assert "groups" not in summarise_set([short, short])
    groups = summarise_set([a_summary(), short, a_summary()])["groups"]
    assert [(group["platform"], group["mean"]["el"]) for group in groups] == [
        ("drone", 10.0),
        ("wheeled", 6.0),
    ]


def test_ar_is_averaged_only_when_every_trial_knows_it():
    blind = a_summary([a_step(step, distance_m=None, bearing_rad=None) for step in range(11)])
    assert "ar" in summarise_set([a_summary()])["mean"]
    assert "ar" not in summarise_set([a_summary(), blind])["mean"]


def test_the_table_has_the_papers_row():
    short = a_summary([a_step(step) for step in range(7)], outcome="lost")
    (row,) = [line for line in drawn([a_summary(), short]).splitlines() if line.split()[:1] == ["drone"]]
    assert row.split() == ["drone", "pid", "2", "1.00", "±", "0.00", "8", "±", "3", "0.50"]


def test_the_table_fits_a_terminal_and_hides_nothing():
    text = drawn([a_summary(trial=Path("trials/20260102-030405-006_drone_sitl"))])
    assert "…" not in text
    assert "20260102-030405-006_drone_sitl" in text


def test_a_trial_whose_timing_was_not_kept_is_listed_and_left_out_of_means_unless_asked_for():
    late = a_summary(
        [a_step(step, box=None if step else REFERENCE, missed_deadlines=5) for step in range(11)]
    )
    assert not late["timing_kept"]
    both = summarise_set([a_summary(), late])
    assert len(both["trials"]) == 2
    assert (both["mean"]["mr"], both["left_out"], both["outcomes"]) == (1.0, 1, {"completed": 1})
    assert "completed, late" in drawn([a_summary(), late])
    assert "1 left out, whose timing was not kept" in drawn([a_summary(), late])
    assert "over 1 trials each" in real_world_table([a_summary(), late])
    asked_for = summarise_set([a_summary(), late | {"counted": True}])
    assert (asked_for["mean"]["mr"], asked_for["left_out"]) == (0.5, 0)


def test_where_no_trial_kept_its_timing_there_are_no_means():
    late = a_summary([a_step(step, missed_deadlines=5) for step in range(11)])
    assert summarise_set([late, late])["mean"] == {"mr": None, "el": None, "sr": None}
    assert "no trial kept its timing" in drawn([late])


@pytest.mark.parametrize("width", [40, 60, 80])
def test_no_width_cuts_a_number(width):
    trials = [a_summary(), a_summary([a_step(step) for step in range(7)], outcome="safety_stop")]
    comparison = compare(trials, trials)
    for table in (summary_table(trials), stage_table(trials), comparison_table(comparison, trials, trials)):
        console = Console(file=io.StringIO(), width=width)
        console.print(table)
        assert "…" not in console.file.getvalue()
    console = Console(file=io.StringIO(), width=60)
    console.print(summary_table(trials))
    text = console.file.getvalue()
    assert max(map(len, text.splitlines())) <= 60
    assert "1.00" in next(line for line in text.splitlines() if "safety_stop" in line)
    assert "not shown at this width:" in text
