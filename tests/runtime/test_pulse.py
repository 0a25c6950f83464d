"""A process that hangs is told from one that runs, and from a machine that held up whoever looked."""

from __future__ import annotations

from itertools import count

from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.runtime.pulse import LONGEST_LOOK_S, SILENT_S, Pulse


def test_a_process_that_writes_nothing_new_hangs():
    pulse, looks = Pulse(), 0
    for looks in count():
        pulse = pulse.look(7, looks * 0.1)
        if not pulse.beats:
            break
    assert SILENT_S <= looks * 0.1 <= SILENT_S + 0.3
    assert pulse.look(8, looks * 0.1 + 0.1).beats


@given(st.lists(st.floats(0.001, 2.0), max_size=60))
def test_one_that_writes_between_two_looks_never_does(gaps_s):
    pulse, now_s = Pulse(), 0.0
    for beat, gap_s in enumerate(gaps_s):
        now_s += gap_s
        pulse = pulse.look(beat, now_s)
        assert pulse.beats


@given(st.lists(st.floats(LONGEST_LOOK_S * 1.01, 60.0), max_size=60))
def test_who_was_held_up_itself_does_not_know(gaps_s):
    pulse, now_s = Pulse(), 0.0
    for gap_s in gaps_s:
        now_s += gap_s
        pulse = pulse.look(7, now_s)
        assert pulse.beats
