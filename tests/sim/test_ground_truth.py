"""The ground-truth record is read in order of time, from all its writers, up to the last whole line."""

from __future__ import annotations

import math
import os

from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_deploy.sim.ground_truth import Account, GroundTruthRecorder, Told, read_witness


def test_what_two_processes_write_is_one_story(tmp_path):
    path = tmp_path / "witness.txt"
    robot, tracker = GroundTruthRecorder(path), GroundTruthRecorder(path)
    robot.command(Twist(0.5, 0.0, 0.1, -0.25))
    tracker.fault("link_drop", begins=True)
    robot.speed(0.48)
    robot.command(ZERO)
    tracker.fault("link_drop", begins=False)
    robot.off()
    robot.close()
    tracker.close()
    account = read_witness(path.read_text())
    told, zero = account.commands
    assert (told.vx, told.vy, told.vz, told.yaw_rate, told.moves) == (0.5, 0.0, 0.1, -0.25, True)
    assert not zero.moves
    assert [(name, begins) for _, name, begins in account.faults] == [
        ("link_drop", True),
        ("link_drop", False),
    ]
    onset_ns = account.onset_ns("link_drop")
    assert told.t_ns <= onset_ns <= account.speeds[0][0] <= zero.t_ns
    assert account.speeds[0][1] == 0.48
    assert account.off
    assert account.onset_ns("camera_gone") is None
    assert path.stat().st_mode & 0o077 == 0


def test_one_without_a_file_and_one_that_was_closed_write_nothing(tmp_path):
    path = tmp_path / "witness.txt"
    for witness in (GroundTruthRecorder(), GroundTruthRecorder(path)):
        witness.close()
        witness.close()
        witness.command(Twist(1.0))
    assert path.read_text() == ""


def test_climbing_is_no_motion_over_the_ground_and_what_is_not_finite_is():
    assert not Told(0, 0.0, 0.0, 0.8, 0.0).moves
    assert Told(0, math.nan, 0.0, 0.0, 0.0).moves
    assert Told(0, 0.0, 0.0, 0.0, -0.001).moves


def test_a_line_that_was_cut_off_counts_as_none():
    whole = "10 command 1 0 0 0\n20 speed 0.5\n30 command 0 0 0 0\n"
    for cut in range(len(whole)):
        account = read_witness(whole[:cut])
        assert len(account.commands) <= 2
        assert all(told.t_ns in (10, 30) for told in account.commands)
    assert read_witness("12 command 1 0") == Account()


@given(st.text())
def test_rubbish_is_no_story_and_no_error(text):
    assert isinstance(read_witness(text), Account)


def test_a_flight_its_phases_and_who_is_who_are_read_as_they_were_written(tmp_path):
    path = tmp_path / "witness.txt"
    witness = GroundTruthRecorder(path)
    witness.process("robot")
    witness.phase("climbing")
    for armed in (False, True, True):  # only changes are written
        witness.mode("TAKEOFF", armed=armed)
    witness.flight(0.8, 1.25)
    witness.speed(0.4)
    witness.record_fault("link_drop")
    witness.stood(0.104)
    witness.close()
    account = read_witness(path.read_text())
    assert [(mode, armed) for _, mode, armed in account.modes] == [("TAKEOFF", False), ("TAKEOFF", True)]
    assert [(moment.up_m_s, moment.height_m) for moment in account.flight] == [(0.8, 1.25)]
    last_ns = account.stood[0][0]
    assert (account.phase_at(last_ns), account.phase_at(0)) == ("climbing", "")
    assert (account.speed_at(last_ns), account.speed_at(0)) == (0.4, 0.0)
    assert (account.process("robot"), account.process("tracker")) == (os.getpid(), None)
    assert [name for _, name in account.suffered] == ["link_drop"]
    assert account.over_ns("link_drop") is None
