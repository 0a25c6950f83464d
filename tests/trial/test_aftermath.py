"""The black box shows what happened after a log's end: in numbers, in a report and in a replay."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.core.messages import ZERO, PlatformState, Twist
from adatracker_deploy.policy.pid import PidPolicy
from adatracker_deploy.runtime.black_box import FILE_NAME, BlackBox, Moment
from adatracker_deploy.runtime.link import LinkStatus, Phase
from adatracker_deploy.runtime.wire import pack_status
from adatracker_deploy.trial.aftermath import aftermath
from adatracker_deploy.trial.reader import read_trial
from tests.replay.trials import logged, observations
from tests.report.pages import Page, write_trial
from tests.trial.records import START_NS, a_step

SLOT_NS = 20_000_000
GO = Twist(vx=0.8)


def statuses(last_step_ns):
    """Yield a link's statuses as its tracker is killed: it sends on for 0.1 s, then disengages and brakes."""
    state = PlatformState(t_ns=1, mode="DRIVE", engaged=True, velocity=GO)
    for slot in range(-20, 60):
        after_s = slot * 0.02
        phase, stopped = (
            (Phase.ACTIVE, "")
            if after_s < 0.1
            else (Phase.DISENGAGING, "tracker_gone")
            if after_s < 1.0
            else (Phase.DONE, "tracker_gone")
        )
        speed = max(0.0, 0.8 - 2 * max(0.0, after_s - 0.1))
        yield LinkStatus(
            phase,
            replace(state, velocity=Twist(vx=speed)),
            sent=GO if phase is Phase.ACTIVE else ZERO,
            stopped=stopped,
            t_ns=last_step_ns + slot * SLOT_NS,
        )


def moments(last_step_ns, asleep_ns=0):
    return [
        Moment(status.t_ns, status.t_ns + (asleep_ns if number > 60 else 0), None, status)
        for number, status in enumerate(statuses(last_step_ns))
    ]


def test_it_says_when_the_last_command_came_and_when_the_robot_stood():
    found = aftermath(moments(START_NS), START_NS)
    assert found.told_s == pytest.approx(0.08)
    assert found.stood_s == pytest.approx(0.44, abs=0.03)
    assert found.lasted_s == pytest.approx(1.18)
    assert [(change.phase, change.reason) for change in found.changes] == [
        ("active", ""),
        ("disengaging", "tracker_gone"),
        ("done", "tracker_gone"),
    ]
    assert "the last command that moves came 0.08 s after it, it stood after 0.4" in found.summary
    assert "slept" not in found.summary


def test_a_suspend_is_told():
    assert "the machine slept for 2.0 s" in aftermath(moments(START_NS, 2_000_000_000), START_NS).summary


def test_a_robot_that_tells_no_speed_was_not_seen_to_stand():
    silent = [
        replace(each, status=replace(each.status, state=replace(each.status.state, velocity=None)))
        for each in moments(START_NS)
    ]
    assert aftermath(silent, START_NS).stood_s is None


def test_a_log_that_goes_on_as_long_as_the_link_has_no_aftermath():
    assert aftermath(moments(START_NS), START_NS + 10**12) is None
    assert aftermath((), None) is None


@pytest.fixture
def cut_short(tmp_path):
    """A trial whose tracker was killed."""
    steps = [a_step(number) for number in range(21)]
    return filled(write_trial(tmp_path / "trial", steps), steps[-1].t_ns)


def filled(folder, last_step_ns):
    box = BlackBox(folder / FILE_NAME)
    for status in statuses(last_step_ns):
        box.record(None, pack_status(status))
    box.close()
    return folder


def test_a_report_shows_it(cut_short, tmp_path):
    page = tmp_path / "page.html"
    assert main(["report", str(cut_short), "--out", str(page)]) == 0
    text = Page(page.read_text()).text
    assert "the link's black box" in text
    assert "tracker_gone" in text
    assert "the last command that moves came 0.08 s after it" in text


def test_a_replay_tells_it(tmp_path, capsys):
    trial = logged(tmp_path, PidPolicy(), observations(10), ends=False)
    filled(tmp_path, read_trial(trial).steps[-1].t_ns)
    assert main(["replay", str(trial)]) == 0
    assert "the last command that moves came 0.08 s after it" in capsys.readouterr().out
    assert main(["replay", str(trial), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["after_log"]["changes"][-1]["phase"] == "done"


def test_a_trial_that_ended_in_order_shows_none(tmp_path, cut_short):
    steps = [a_step(number) for number in range(21)]
    folder = write_trial(tmp_path / "whole", steps, summary={"outcome": "safety_stop"})
    (cut_short / FILE_NAME).rename(folder / FILE_NAME)
    page = tmp_path / "page.html"
    assert main(["report", str(folder), "--out", str(page)]) == 0
    assert "black box" not in Page(page.read_text()).text
