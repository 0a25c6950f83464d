"""No row says that all is well when its fault did nothing; each does when it was stopped as it should."""

from __future__ import annotations

from dataclasses import replace

import pytest

from adatracker_deploy.core.faults import OURS
from adatracker_deploy.faults.evidence import without_effect
from adatracker_deploy.faults.judge import judge
from adatracker_deploy.faults.matrix import ROWS
from adatracker_deploy.faults.phase_rows import PHASE_FAULTS, PHASE_ROWS, absent_in_phase, all_rows, has_phase
from adatracker_deploy.faults.phases import ORDER, TrialPhase
from adatracker_deploy.sim.ground_truth import Told

from .evidences import ONSET_NS, as_it_should, commands, nothing_happened, ns

ROBOTS = {"drone": True, "quadruped": False, "ros2": False, "wheeled": False}
CELLS = [
    pytest.param(row, robot, id=f"{robot}-{row.name}")
    for robot, flies in ROBOTS.items()
    for row in all_rows(robot, flies=flies)
]


def judged(row, robot, evidence):
    return judge(row, robot, "", evidence, flies=ROBOTS[robot], accel_m_s2=100.0)


@pytest.mark.parametrize(("row", "robot"), CELLS)
def test_a_fault_that_took_effect_and_was_stopped_in_time_is_ok(row, robot):
    result = judged(row, robot, as_it_should(row, robot))
    assert (result.verdict, result.note) == ("ok", result.note if not row.stops else "")
    assert result.onset_m_s == (0.8 if row.moves else 0.0)


@pytest.mark.parametrize(("row", "robot"), CELLS)
def test_an_injector_that_did_nothing_is_never_ok(row, robot):
    result = judged(row, robot, nothing_happened(row, robot))
    assert result.verdict == "WRONG"
    assert result.note


@pytest.mark.parametrize(("row", "robot"), CELLS)
def test_a_run_that_ended_as_it_should_without_the_faults_own_sign_is_not_ok(row, robot):
    """The right ending alone shows nothing, of faults that leave a sign."""
    good, nothing = as_it_should(row, robot), nothing_happened(row, robot)
    bare = replace(
        good,
        account=replace(good.account, suffered=(), stood=()),
        seen=nothing.seen,
        ticks=nothing.ticks,
        status=1,
        log_trouble=False,
    )
    if without_effect(row.fault, bare, ONSET_NS):
        assert judged(row, robot, bare).verdict == "WRONG"
    else:  # it must end the trial, for a reason that nothing else gives
        assert row.fault in {fault.name for fault in OURS}
        assert row.stops
        assert row.words
        assert judged(row, robot, replace(bare, reason="something else")).verdict == "WRONG"


@pytest.mark.parametrize(("row", "robot"), [cell for cell in CELLS if cell.values[0].moves])
def test_a_robot_that_stood_at_the_onset_shows_nothing(row, robot):
    good = as_it_should(row, robot)
    stood = replace(good.account, speeds=tuple((t_ns, 0.1) for t_ns, _ in good.account.speeds))
    assert "was not moving at the onset: 0.10 m/s" in judged(row, robot, replace(good, account=stood)).note


@pytest.mark.parametrize(("row", "robot"), CELLS)
def test_a_fault_that_struck_in_another_phase_shows_nothing_of_this_one(row, robot):
    good = as_it_should(row, robot)
    other = TrialPhase.LOOKING if row.phase is not TrialPhase.LOOKING else TrialPhase.FOLLOWING
    moved = replace(good.account, phases=((ns(-0.2), str(other)),))
    assert judged(row, robot, replace(good, account=moved)).note == f"it struck while {other}"


def row_of(fault, phase):
    return next(row for row in PHASE_ROWS if (row.fault, row.phase) == (fault, phase))


def test_offboard_after_the_onset_is_wrong_however_it_ended():
    row = row_of("interrupt", TrialPhase.CLIMBING)
    good = as_it_should(row, "drone")
    modes = ((ns(-1.0), "TAKEOFF", True), (ns(1.1), "OFFBOARD", True), (ns(1.8), "LAND", True))
    result = judged(row, "drone", replace(good, account=replace(good.account, modes=modes)))
    assert (result.verdict, result.note) == ("WRONG", "OFFBOARD 1.1 s after it")
    disarmed = (
        *((t_ns, mode, True) for t_ns, mode, _ in modes if mode != "OFFBOARD"),
        (ns(3.0), "OFFBOARD", False),
    )
    landed = judged(row, "drone", replace(good, account=replace(good.account, modes=disarmed)))
    assert landed.verdict == "ok"  # PX4 goes back to it once it has disarmed


def test_a_drone_that_bounces_as_it_touches_down_does_not_climb():
    row = row_of("interrupt", TrialPhase.CLIMBING)
    good = as_it_should(row, "drone")
    bounce = tuple(replace(one, up_m_s=0.5) if one.height_m < 0.1 else one for one in good.account.flight)
    assert judged(row, "drone", replace(good, account=replace(good.account, flight=bounce))).verdict == "ok"


def test_a_drone_that_climbs_on_is_late_and_one_that_does_not_come_down_is_wrong():
    row = row_of("interrupt", TrialPhase.CLIMBING)
    good = as_it_should(row, "drone")
    climbs = tuple(replace(one, up_m_s=0.5 if one.t_ns < ns(0.7) else -0.5) for one in good.account.flight)
    late = judged(row, "drone", replace(good, account=replace(good.account, flight=climbs)))
    assert (late.verdict, late.value_s) == ("LATE", pytest.approx(0.6, abs=0.05))
    hovers = tuple(replace(one, height_m=2.0) for one in good.account.flight)
    wrong = judged(row, "drone", replace(good, account=replace(good.account, flight=hovers)))
    assert (wrong.verdict, wrong.note) == ("WRONG", "not landed: 2.0 m high")


def test_a_command_after_waking_is_late_and_one_on_its_way_when_it_slept_is_not():
    row = row_of("suspend", TrialPhase.LOOKING)
    good = as_it_should(row, "wheeled")

    def told(at_s):
        moving = Told(ns(at_s), 0.4, 0.0, 0.0, 0.0)
        return replace(good, account=replace(good.account, commands=(*commands(-1, 0), moving)))

    assert judged(row, "wheeled", told(0.1)).verdict == "ok"
    assert judged(row, "wheeled", told(2.1)).verdict == "LATE"


def test_another_trial_after_a_stop_is_wrong():
    row = row_of("interrupt", TrialPhase.DISENGAGING)
    good = as_it_should(row, "wheeled")
    again = replace(good.account, phases=(*good.account.phases, (ns(3.0), "engaging")))
    result = judged(row, "wheeled", replace(good, account=again))
    assert result.note == "another trial was engaged after it"


def test_every_cell_of_the_table_has_a_row_or_says_why_not():
    for robot, flies in ROBOTS.items():
        rows = {(row.fault, row.phase) for row in all_rows(robot, flies=flies)}
        for phase in ORDER:
            for fault in PHASE_FAULTS:
                if phase is TrialPhase.FOLLOWING or not has_phase(phase, flies=flies):
                    continue
                why = absent_in_phase(robot, fault, phase, flies=flies)
                assert ((fault, phase) in rows) != bool(why), (robot, fault, phase)


def test_every_row_is_of_its_own():
    names = [row.name for row in (*ROWS, *PHASE_ROWS)]
    assert len(set(names)) == len(names)
    assert {fault for row in PHASE_ROWS for fault in [row.fault]} == set(PHASE_FAULTS)
