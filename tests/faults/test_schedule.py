"""A schedule is read as it was written, in order of time; what is none is refused in one line."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.faults import CAMERA_GONE, OURS, Fault, known_faults
from adatracker_deploy.faults.phases import IN_FLIGHT, ORDER, TrialPhase
from adatracker_deploy.faults.schedule import LATEST_S, ScheduledFault, next_due, parse_schedule
from adatracker_deploy.runtime.loop import BLIND_S

KNOWN = known_faults((CAMERA_GONE,))
NAMES = st.sampled_from(sorted(KNOWN))
TIMES = st.integers(0, 3_600_000).map(lambda ms: ms / 1000)


@given(st.dictionaries(NAMES, TIMES, min_size=1, max_size=8), st.booleans(), st.randoms())
def test_what_is_written_is_read_and_sorted(times, in_one_text, random):
    parts = [
        f"{name}@{at_s:g}" if at_s == int(at_s) else f"{name}@{at_s:.3f}" for name, at_s in times.items()
    ]
    random.shuffle(parts)
    strikes = parse_schedule([",".join(parts)] if in_one_text else parts, KNOWN)
    assert {strike.fault.name: strike.at_s for strike in strikes} == times
    assert [strike.at_s for strike in strikes] == sorted(times.values())


@given(st.text() | st.from_regex(r"[a-z_]{1,12}@[0-9.eE+-]{0,8}(,[a-z_]{0,12}@?[0-9]{0,3})?", fullmatch=True))
def test_anything_else_is_refused_in_one_line_or_is_a_schedule(text):
    refusal, strikes = "", ()
    try:
        strikes = parse_schedule([text], KNOWN)
    except UsageError as error:
        refusal = str(error)
    assert bool(strikes) != refusal.startswith("--fault ")
    assert "\n" not in refusal
    assert all(strike.fault in KNOWN.values() and 0 <= strike.at_s <= LATEST_S for strike in strikes)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "expected NAME@SECONDS, NAME@PHASE or NAME@PHASE+SECONDS, for example action_jump@5"),
        ("link_kill@landing", "this robot's phases are connecting"),
        ("link_kill@stopping+", "expected NAME@SECONDS"),
        ("policy_hang@looking,policy_hang@looking+1", "policy_hang@looking+1: it lasts until 2 s"),
        ("link_kill", "expected NAME@SECONDS"),
        ("link_kill@-1", "expected NAME@SECONDS"),
        ("link_kill@nan", "this robot's phases are connecting"),
        ("link_kill@1e3", "expected NAME@SECONDS"),
        ("link_kill@3,", "expected NAME@SECONDS"),
        ("link_kill@3600.5", "3600.5 s is out of range [0, 3600]"),
        (
            "earthquake@3",
            "unknown for this rehearsal; known are action_jump, camera_freeze, camera_gone, cpu_h",
        ),
        ("policy_hang@3,policy_hang@4.9", "it lasts until 5 s from before"),
        ("policy_nan@3,policy_nan@60", "it lasts until 3600 s from before"),
    ],
)
def test_what_is_wrong_is_named(text, words):
    with pytest.raises(UsageError) as refused:
        parse_schedule([text], KNOWN)
    assert words in str(refused.value)


def test_a_fault_that_is_over_may_come_again():
    strikes = parse_schedule(["policy_hang@3", "policy_hang@5.5"], KNOWN)
    assert [strike.at_s for strike in strikes] == [3.0, 5.5]


@given(NAMES, st.sampled_from(ORDER), TIMES)
def test_a_strike_is_written_as_it_is_read(name, phase, at_s):
    strike = ScheduledFault(KNOWN[name], at_s, phase)
    (read,) = parse_schedule([f"{name}@{phase}+{at_s:.3f}"], KNOWN, flies=True)
    assert read == strike
    if at_s == round(at_s, 3) and at_s < 1000:  # as many digits as %g shows
        assert parse_schedule([str(strike)], KNOWN, flies=True) == (strike,)


def test_phases_are_named_come_in_their_order_and_a_climb_is_a_drones():
    strikes = parse_schedule(
        ["interrupt@stopping+0.2", "link_kill@3,suspend@climbing", "link_stop@connecting"], KNOWN, flies=True
    )
    assert [str(strike) for strike in strikes] == [
        "link_stop@connecting",
        "suspend@climbing",
        "link_kill@3",
        "interrupt@stopping+0.2",
    ]
    for phase in IN_FLIGHT:
        with pytest.raises(UsageError, match="phases are connecting, engaging, looking"):
            parse_schedule([f"interrupt@{phase}"], KNOWN)


@given(st.lists(st.builds(ScheduledFault, st.sampled_from(OURS), TIMES, st.sampled_from(ORDER)), max_size=10))
def test_what_is_due_next_is_the_soonest_of_the_phases_that_were_entered(strikes):
    entered = {TrialPhase.CONNECTING: 100.0, TrialPhase.FOLLOWING: 105.0}
    due = next_due(strikes, entered)
    times = [entered[strike.phase] + strike.at_s for strike in strikes if strike.phase in entered]
    assert (due is None) == (not times)
    if due is not None:
        assert due[0] == min(times) == entered[due[1].phase] + due[1].at_s


def test_a_simulators_own_way_comes_before_ours():
    theirs = Fault("camera_freeze", "its own way", 7.0)
    assert known_faults((theirs,))["camera_freeze"] is theirs
    assert known_faults(())["camera_freeze"].lasts_s > BLIND_S
    assert all(math.isfinite(fault.lasts_s) for fault in KNOWN.values())
