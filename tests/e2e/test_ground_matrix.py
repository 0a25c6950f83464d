"""A row of the fault matrix, and what it leaves in the log; CI runs them all (`adatracker-deploy faults`)."""

from __future__ import annotations

import pytest

from adatracker_deploy.faults.catalogue import known_faults
from adatracker_deploy.faults.matrix import ROWS
from adatracker_deploy.faults.rehearse import rehearse
from adatracker_deploy.faults.stalls import Stalls
from adatracker_deploy.platform import load_platform
from adatracker_deploy.profile import load_profile
from adatracker_deploy.trial.reader import find_trials, read_trial

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]

BUSY_S = 0.25
"""What two busy cores may add, besides stalls of the whole machine that were seen."""


def test_a_row_stops_in_time_stays_stopped_and_leaves_its_word_in_the_log(tmp_path, measured):
    platform, fault = "wheeled", "camera_freeze"
    row = next(row for row in ROWS if row.fault == fault)
    robot = load_platform(platform)
    known = known_faults(robot.sitl(load_profile(robot.default_profile, robot)).faults)
    with Stalls() as stalls:
        result = rehearse(row, platform, known[fault].says, stalls, tmp_path)
    measured(
        f"{platform}, {fault}: told {result.told_s}, latched {result.latched_s}, stands {result.stands_s} s, "
        f"machine stalled {result.stall_s:.2f} s"
    )
    assert result.verdict in ("ok", "LATE"), result
    assert result.value_s is not None
    assert result.value_s < row.limit_of(platform) + BUSY_S + 2 * result.stall_s
    (path,) = find_trials(tmp_path)
    trial = read_trial(path)
    messages = [event.message for event in trial.events]
    assert f"fault: {fault} begins" in messages
    assert trial.config["faults"] == [f"{fault}@3"]
    assert (f"fault: {fault} is over" in messages) == bool(known[fault].lasts_s)
