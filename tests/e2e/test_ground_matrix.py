"""Rows of the fault matrix, what they leave, and that none is ok whose injector does nothing.

CI runs them all every night (`adatracker-deploy faults`), and a sample for each change.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from adatracker_deploy.core.faults import known_faults
from adatracker_deploy.faults.judge import MOVING_M_S
from adatracker_deploy.faults.matrix import FOLLOWED_S, ROWS
from adatracker_deploy.faults.phase_rows import PHASE_ROWS
from adatracker_deploy.faults.rehearse import rehearse
from adatracker_deploy.faults.stalls import StallMonitor
from adatracker_deploy.registry import load_platform, load_profile
from adatracker_deploy.trial.reader import find_trials, read_trial
from tests.tiers import EXHAUSTIVE

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]

PLATFORM = "wheeled"
TOOTHLESS = Path(__file__).parents[1] / "faults" / "toothless.py"
BUSY_S = 0.25
"""What two busy cores may add, besides stalls of the whole machine that were seen."""


def run(row, folder):
    robot = load_platform(PLATFORM)
    known = known_faults(robot.sitl(load_profile(robot.default_profile, robot)).faults)
    with StallMonitor() as stalls:
        return rehearse(row, PLATFORM, known[row.fault].says, stalls, folder), known[row.fault]


def row_of(name):
    return next(row for row in (*ROWS, *PHASE_ROWS) if row.name == name)


@EXHAUSTIVE  # the everyday sample of the matrix has the row
def test_a_row_stops_in_time_stays_stopped_and_leaves_its_word_in_the_log(tmp_path, measured):
    row = row_of("camera_freeze")
    result, fault = run(row, tmp_path)
    measured(
        f"{PLATFORM}, {row.name}: told {result.told_s}, latched {result.latched_s}, stands {result.stands_s} "
        f"s, machine stalled {result.stall_s:.2f} s"
    )
    assert result.verdict in ("ok", "LATE"), result
    assert result.value_s is not None
    assert result.value_s < row.limit_of(PLATFORM) + BUSY_S + 2 * result.stall_s
    assert result.onset_m_s > MOVING_M_S
    (path,) = find_trials(tmp_path)
    trial = read_trial(path)
    messages = [event.message for event in trial.events]
    assert "fault: camera_freeze begins" in messages
    assert trial.config["faults"] == [f"camera_freeze@{FOLLOWED_S:g}"]
    assert ("fault: camera_freeze is over" in messages) == bool(fault.lasts_s)


@EXHAUSTIVE
def test_after_a_killed_tracker_a_second_run_engages_the_same_robot_again(tmp_path):
    result, _ = run(row_of("tracker_kill@engaging"), tmp_path)
    assert (result.verdict, result.again) == ("ok", "engages again"), result


@EXHAUSTIVE
@pytest.mark.parametrize(
    "name",
    ["link_stop@engaging", "gc_pause", "tracker_kill", "interrupt@disengaging"],
)
def test_a_row_whose_injector_does_nothing_is_not_ok(tmp_path, monkeypatch, name):
    row = row_of(name)
    command = (sys.executable, str(TOOTHLESS), row.fault)
    monkeypatch.setattr("adatracker_deploy.faults.rehearse.COMMAND", command)
    result, _ = run(row, tmp_path)
    assert result.verdict == "WRONG", result
    assert result.note
