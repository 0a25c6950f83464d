"""A row is judged by what the simulated robot saw: in time, late, or something else altogether."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest

from adatracker_deploy.faults.evidence import Evidence, Tick
from adatracker_deploy.faults.judge import judge
from adatracker_deploy.faults.matrix import Row
from adatracker_deploy.sim.ground_truth import Account, Told

ONSET_NS = 5_000_000_000
STOP = Row("link_drop", "told", 0.3, frozenset({"safety_stop"}))


def commands(until_s, vx=0.8, slot_s=0.02, since_s=-1.0):
    """Commands at the link's rate until `until_s` after the onset, then zeros."""
    slots = range(round(since_s / slot_s), round(2.0 / slot_s))
    return tuple(
        Told(ONSET_NS + round(slot * slot_s * 1e9), vx if slot * slot_s <= until_s else 0.0, 0.0, 0.0, 0.0)
        for slot in slots
    )


def evidence(until_s=0.2, **changes):
    speeds = tuple((ONSET_NS + round(t * 1e8), max(0.0, 0.8 - 0.1 * max(0, t))) for t in range(-10, 20))
    account = Account(
        commands(until_s),
        speeds,
        ((ONSET_NS, "link_drop", True),),
        off=True,
        phases=((ONSET_NS - 3_000_000_000, "following"),),
        suffered=((ONSET_NS, "link_drop"),),
    )
    seen = Evidence(account=account, status=1, outcome="safety_stop", reason="no picture")
    return replace(seen, **changes)


def judged(seen, row=STOP):
    return judge(row, "wheeled", "gone", seen, flies=False, accel_m_s2=1.5)


def test_a_stop_in_time_is_ok_and_measured_to_the_last_motion_command():
    result = judged(evidence(0.2))
    assert result.verdict == "ok"
    assert result.told_s == pytest.approx(0.2)
    assert result.stands_s == pytest.approx(0.7)  # the last sample above 0.05 m/s
    assert (result.limit, result.fault, result.platform) == ("told 0.3 s", "link_drop", "wheeled")


def test_a_stop_that_comes_too_late_is_late():
    assert judged(evidence(0.32)).verdict == "LATE"


def test_motion_that_resumes_after_the_return_is_late_however_soon_it_stopped():
    seen = evidence(0.1)
    again = Told(ONSET_NS + 2_500_000_000, 0.1, 0.0, 0.0, 0.0)
    account = replace(seen.account, commands=(*seen.account.commands, again))
    result = judged(replace(seen, account=account))
    assert (result.verdict, result.told_s) == ("LATE", pytest.approx(2.5))


@pytest.mark.parametrize(
    ("changes", "note"),
    [
        ({"outcome": "completed"}, "ended as completed"),
        ({"log_whole": False}, "the log is incomplete"),
        ({"outcome": ""}, "ended as nothing"),
        ({"account": Account()}, "it ended before: no picture"),
        ({"account": replace(evidence().account, off=False)}, "was not seen to come to rest"),
        (
            {"account": replace(evidence().account, speeds=((ONSET_NS, 0.1),))},
            "not moving at the onset: 0.10",
        ),
        ({"account": replace(evidence().account, suffered=())}, "the robot did not report the fault"),
        ({"account": replace(evidence().account, phases=())}, "it struck while nothing was on"),
    ],
)
def test_what_shows_nothing_or_something_else_is_wrong(changes, note):
    result = judged(evidence(**changes))
    assert result.verdict == "WRONG"
    assert note in result.note


def test_where_nothing_reaches_the_robot_the_links_stop_counts():
    row = Row("link_drop", "latched", 0.3, frozenset({"safety_stop"}), {"wheeled": 0.2})
    assert judged(evidence(0.0, latched_s=0.19), row).verdict == "ok"
    assert judged(evidence(0.0, latched_s=0.21), row).verdict == "LATE"
    assert judged(evidence(0.0), row).verdict == "LATE"  # none was latched
    assert row.limit_of("drone") == 0.3


def test_where_nobody_commands_any_more_the_robots_standing_counts():
    row = replace(STOP, measure="stands")
    assert judged(evidence(), replace(row, limit_s=0.75)).verdict == "ok"
    assert judged(evidence(), replace(row, limit_s=0.65)).verdict == "LATE"


def went_on(measure, limit_s, **changes):
    return judged(
        evidence(9.0, outcome="completed", **changes),
        Row("link_drop", measure, limit_s, frozenset({"completed"})),
    )


def test_a_gate_that_was_late_for_a_slot_is_found():
    on_time = evidence().account
    gap = tuple(told for told in commands(9.0) if not 0.1 < (told.t_ns - ONSET_NS) / 1e9 < 0.16)
    assert went_on("gap", 0.02).verdict == "ok"
    assert went_on("gap", 0.02, account=replace(on_time, commands=gap)).verdict == "WRONG"
    spans = tuple(told for told in commands(9.0) if not -0.03 < (told.t_ns - ONSET_NS) / 1e9 < 0.03)
    assert went_on("gap", 0.02, account=replace(on_time, commands=spans)).verdict == "WRONG"
    before = tuple(told for told in commands(9.0) if not -0.08 < (told.t_ns - ONSET_NS) / 1e9 < -0.02)
    assert went_on("gap", 0.02, account=replace(on_time, commands=before)).verdict == "ok"


def ticks(*gaps_s):
    """Ticks after the onset, so far apart."""
    times_s = itertools.accumulate((0.1, *gaps_s))
    return tuple(Tick(ONSET_NS + round(t_s * 1e9), 0, ()) for t_s in times_s)


def test_ticks_that_come_in_a_burst_are_found_and_missed_ones_are_counted():
    calm = went_on("burst", 0.49, ticks=ticks(0.1, 0.1, 0.3, 0.1, 0.051))
    assert (calm.verdict, calm.note) == ("ok", "slots missed: 2")
    assert went_on("burst", 0.49, ticks=ticks(0.1, 0.1, 0.3, 0.1, 0.02)).verdict == "WRONG"
    assert went_on("burst", 0.49).verdict == "WRONG"  # no tick followed


def test_a_jump_of_speed_is_found_and_jitter_and_a_stop_are_none():
    smooth = tuple(replace(told, vx=0.02 * number) for number, told in enumerate(commands(9.0)))
    account = evidence().account
    assert went_on("acceleration", 1.0, account=replace(account, commands=smooth)).verdict == "ok"
    held_ns = ONSET_NS + 8e8  # twelve slots arrive together
    late = tuple(
        replace(told, t_ns=max(told.t_ns, held_ns if told.t_ns > held_ns - 24e7 else 0)) for told in smooth
    )
    assert went_on("acceleration", 1.0, account=replace(account, commands=late)).verdict == "ok"
    jump = tuple(replace(told, vx=1.0 if told.t_ns > ONSET_NS + 5e8 else 0.1) for told in commands(9.0))
    assert went_on("acceleration", 1.0, account=replace(account, commands=jump)).verdict == "WRONG"
    assert went_on("acceleration", 1.0, account=replace(account, commands=commands(0.5))).verdict == "ok"


def test_a_log_that_is_not_whole_must_be_told():
    assert went_on("log", 0.0, log_trouble=True).verdict == "ok"
    assert went_on("log", 0.0).verdict == "WRONG"


def test_a_command_that_ends_late_is_late_unless_its_drone_lands():
    row = replace(STOP, exit_s=2.0)
    assert judged(evidence(exit_s=1.9), row).verdict == "ok"
    assert judged(evidence(exit_s=2.1), row).verdict == "LATE"
    assert judge(row, "drone", "", evidence(exit_s=9.0), flies=True, accel_m_s2=2.5).verdict == "ok"
