"""A part of the fault matrix in real processes: what `adatracker-deploy faults` does for every fault."""

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


@pytest.mark.parametrize(
    ("platform", "fault"),
    [("wheeled", "camera_freeze"), ("wheeled", "tracker_kill"), ("quadruped", "link_drop")],
)
def test_a_row_of_the_matrix(platform, fault, tmp_path, measured):
    shown(platform, fault, tmp_path, measured)


def shown(platform, fault, folder, measured):
    """Rehearse a row and see that it stopped, stayed so, and left its word in the log."""
    row = next(row for row in ROWS if row.fault == fault)
    robot = load_platform(platform)
    known = known_faults(robot.sitl(load_profile(robot.default_profile, robot)).faults)
    with Stalls() as stalls:
        result = rehearse(row, platform, known[fault].says, stalls, folder)
    measured(
        f"{platform}, {fault}: told {result.told_s}, latched {result.latched_s}, stands {result.stands_s} s, "
        f"machine stalled {result.stall_s:.2f} s"
    )
    assert result.verdict in ("ok", "LATE"), result
    assert result.value_s is not None
    assert result.value_s < row.limit_of(platform) + BUSY_S + 2 * result.stall_s
    (path,) = find_trials(folder)
    trial = read_trial(path)
    messages = [event.message for event in trial.events]
    assert f"fault: {fault} begins" in messages
    assert trial.config["faults"] == [f"{fault}@3"]
    assert (f"fault: {fault} is over" in messages) == bool(known[fault].lasts_s)
