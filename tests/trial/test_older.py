"""A log of format 1, whose records mix ticks, is read as one whose records do not."""

from __future__ import annotations

import dataclasses
import json

import pytest
import yaml

from adatracker_deploy.core.messages import Twist
from adatracker_deploy.report.columns import columns
from adatracker_deploy.report.rerun_file import all_series
from adatracker_deploy.scoring.summary import summarise_log
from adatracker_deploy.trial.channels import Message
from adatracker_deploy.trial.reader import read_scored, read_trial
from adatracker_deploy.trial.trial_file import TrialFile
from tests.trial.records import a_step

STEPS = 12
STALE, MISSING = 5, 8


def asked(number):
    return Twist(vx=0.1 * number)


def as_format_1_wrote(number):
    """The command of its own tick; what was sent, why, and the way to the wire of the tick before."""
    latency = dataclasses.replace(
        a_step(number).latency, infer_ms=0 if number == STALE else 2, gate_ms=number - 1, sensor_to_wire_ms=40
    )
    return {
        "step": number,
        "t_ns": a_step(number).t_ns,
        "frame_seq": number,
        **({} if number == STALE else {"box": dataclasses.asdict(a_step(number).box)}),
        "confidence": 0.9,
        "action": [] if number == STALE else [0.5, 0.0],
        "context": [],
        "command": dataclasses.asdict(asked(number)),
        "sent": dataclasses.asdict(asked(number - 1)),
        "gate": [f"tick {number - 1}"],
        "mode": "m",
        "state_age_s": 0.1,
        "latency": {name: value for name, value in dataclasses.asdict(latency).items() if value is not None},
        "missed_deadlines": 0,
    }


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    file = tmp_path_factory.mktemp("old") / "trial.mcap"
    about = {"step_format": "1", "platform": "wheeled", "kind": "real", "policy": "pid", "steps": "11"}
    with file.open("wb") as stream:
        trial = TrialFile(stream, {"trial": about, "config": {"yaml": yaml.safe_dump({})}})
        for number in range(STEPS):
            record = as_format_1_wrote(number)
            if number != MISSING:
                trial.write([Message("/step", record["t_ns"], json.dumps(record).encode(), number)])
        trial.finish(json.dumps({"outcome": "completed"}))
    return file


def test_each_command_stands_with_what_was_sent_for_it(log):
    steps = read_trial(log).steps
    answered = [step for step in steps if step.sent is not None]
    assert [step.step for step in answered] == [n for n in range(11) if n not in (MISSING - 1, MISSING)]
    for step in answered:
        assert step.sent == step.command == asked(step.step)
        assert (step.gate, step.latency.gate_ms) == ((f"tick {step.step}",), step.step)


def test_what_was_not_yet_known_at_the_end_or_before_a_gap_is_not_made_up(log):
    steps = {step.step: step for step in read_trial(log).steps}
    for number in (MISSING - 1, STEPS - 1):
        assert (steps[number].sent, steps[number].gate, steps[number].latency.gate_ms) == (None, (), None)


def test_a_tick_without_an_action_is_stale_and_not_lost(log):
    trial = read_trial(log)
    assert [step.step for step in trial.steps if step.stale] == [STALE]
    assert [step.step for step in read_scored(log).steps if step.stale] == [STALE]
    assert summarise_log(trial) == summarise_log(read_scored(log))
    assert summarise_log(trial)["visibility"] == 1.0


def test_report_and_rerun_show_what_was_sent_beside_what_was_asked(log):
    steps = read_trial(log).steps
    cols = columns(steps)
    both = cols.sent["vx"] == cols.sent["vx"]  # not NaN
    assert both.sum() == 9
    assert cols.sent["vx"][both] == pytest.approx(cols.asked["vx"][both])
    series = all_series(steps)
    assert set(series["velocity/sent/vx"].items()) <= set(series["velocity/asked/vx"].items())
