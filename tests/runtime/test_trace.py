"""Each tick is told once, in order, with what the link made of its own set-point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.messages import ZERO, Frame, Observation, PlatformState, Seen, Twist
from adatracker_deploy.runtime.link import Acted, LinkStatus, Phase
from adatracker_deploy.runtime.trace import PATIENCE_TICKS, Trace
from tests.trial.records import a_step

MS = 1_000_000
MASK = np.zeros((1, 1), np.uint8)
IDLE = LinkStatus(Phase.ACTIVE, PlatformState(1, "OFFBOARD", True, False))


def waiting(trace, t_ms):
    """Hand over the tick of that time, whose frame is 30 ms older, 4 ms later."""
    record = a_step(t_ms, t_ns=t_ms * MS, sent=None, gate=())
    frame_ns = (t_ms - 30) * MS
    seen = Seen(
        Frame(np.zeros((1, 1, 3), np.uint8), frame_ns, t_ms), Observation(MASK, None, 0, frame_ns, t_ms)
    )
    trace.hand_over(record, seen, (t_ms + 4) * MS)


def acted(t_ms, sent=ZERO, reasons=()):
    return replace(
        IDLE, sent=sent, reasons=reasons, acted=Acted(t_ms * MS, (t_ms + 17) * MS, (t_ms + 19) * MS)
    )


def test_a_tick_is_told_with_what_was_sent_for_it_and_how_long_that_took():
    trace = Trace()
    waiting(trace, 100)
    (tick,) = trace.settled(acted(100, Twist(0.7), ("jerk",)))
    latency = tick.record.latency
    assert (tick.record.step, tick.record.sent, tick.record.gate) == (100, Twist(0.7), ("jerk",))
    assert (latency.gate_ms, latency.send_ms, latency.sensor_to_wire_ms) == (13.0, 2.0, 49.0)


def test_what_the_link_sent_for_an_older_set_point_is_no_answer():
    trace = Trace()
    waiting(trace, 100)
    assert trace.settled(None) == []
    assert trace.settled(acted(99, Twist(0.7))) == []
    assert trace.settled(acted(100, Twist(0.8)))[0].record.sent == Twist(0.8)


def test_a_set_point_that_was_replaced_before_the_links_slot_was_never_sent():
    trace = Trace()
    waiting(trace, 100)
    waiting(trace, 150)
    first, second = trace.settled(acted(150, Twist(0.7)))
    assert (first.record.sent, first.record.gate, first.record.latency.gate_ms) == (None, (), None)
    assert second.record.sent == Twist(0.7)


def test_a_stop_is_the_answer_to_the_command_that_it_forestalled():
    trace = Trace()
    waiting(trace, 150)
    (tick,) = trace.settled(replace(acted(100), phase=Phase.HOLDING, reasons=("not_finite",)))
    assert (tick.record.sent, tick.record.gate, tick.record.latency.send_ms) == (ZERO, ("not_finite",), None)


def test_a_link_that_does_not_run_keeps_no_tick_waiting_for_long():
    trace = Trace()
    told = []
    for number in range(10):
        waiting(trace, 100 + number)
        told += trace.settled(acted(99))
        assert len(told) == max(0, number + 1 - PATIENCE_TICKS)
    told += trace.settled(None, patience=0)
    assert [tick.record.step for tick in told] == list(range(100, 110))
    assert {tick.record.sent for tick in told} == {None}


@given(st.sets(st.integers(1, 60)))
@pytest.mark.parametrize("lag", [0, 1])
def test_every_tick_is_told_once_in_order_and_with_its_own_answer(lag, acted_on):
    """One set-point a tick; the link acts on some, and its status is read before a tick, or one later."""
    trace, told, statuses = Trace(), [], [IDLE, IDLE]
    for tick in range(1, 61):
        waiting(trace, tick)
        told += trace.settled(statuses[-1 - lag])
        statuses.append(acted(tick, Twist(tick)) if tick in acted_on else statuses[-1])
    told += trace.settled(statuses[-1], patience=0)
    assert [tick.record.step for tick in told] == list(range(1, 61))
    answered = {tick.record.step: tick.record.sent.vx for tick in told if tick.record.sent}
    assert all(step == sent for step, sent in answered.items())
    if lag == 0:
        assert set(answered) == acted_on
