"""A schedule is read as it was written, in order of time; what is none is refused in one line."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.errors import UsageError
from adatracker_deploy.faults.catalogue import CAMERA_GONE, OURS, Fault, known_faults
from adatracker_deploy.faults.schedule import LATEST_S, Strike, parse_schedule, timeline
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
        ("", "expected NAME@SECONDS, for example action_jump@5"),
        ("link_kill", "expected NAME@SECONDS"),
        ("link_kill@-1", "expected NAME@SECONDS"),
        ("link_kill@nan", "expected NAME@SECONDS"),
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


@given(st.lists(st.builds(Strike, st.sampled_from(OURS), TIMES), max_size=10))
def test_every_strike_begins_and_what_lasts_ends_after_as_long(strikes):
    moments = timeline(strikes)
    assert [moment.at_s for moment in moments] == sorted(moment.at_s for moment in moments)
    begun = [(moment.fault, moment.at_s) for moment in moments if moment.begins]
    ended = [(moment.fault, moment.at_s) for moment in moments if not moment.begins]
    assert sorted(begun, key=str) == sorted(((s.fault, s.at_s) for s in strikes), key=str)
    assert sorted(ended, key=str) == sorted(
        ((s.fault, s.at_s + s.fault.lasts_s) for s in strikes if s.fault.lasts_s), key=str
    )


def test_one_that_ends_as_another_begins_ends_first():
    hang = KNOWN["policy_hang"]
    moments = timeline([Strike(hang, 1.0), Strike(hang, 3.0)])
    assert [(moment.at_s, moment.begins) for moment in moments] == [
        (1.0, True),
        (3.0, False),
        (3.0, True),
        (5.0, False),
    ]


def test_a_far_ends_own_way_comes_before_ours():
    theirs = Fault("camera_freeze", "its own way", 7.0)
    assert known_faults((theirs,))["camera_freeze"] is theirs
    assert known_faults(())["camera_freeze"].lasts_s > BLIND_S
    assert all(math.isfinite(fault.lasts_s) for fault in KNOWN.values())
