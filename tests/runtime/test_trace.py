"""Each set-point that reached the robot is told once, with the frame that it was made from."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.runtime.link import Acted
from adatracker_deploy.runtime.trace import Arrival, Trace

MS = 1_000_000


def test_the_way_of_a_set_point_is_split_at_the_hand_over_and_at_the_gate():
    trace = Trace()
    trace.hand_over(setpoint_ns=100 * MS, frame_ns=70 * MS, handed_ns=104 * MS)
    arrival = trace.arrived(Acted(setpoint_ns=100 * MS, judged_ns=117 * MS, sent_ns=119 * MS))
    assert arrival == Arrival(gate_ms=13.0, send_ms=2.0, sensor_to_wire_ms=49.0)


def test_what_the_link_did_before_the_loop_began_is_none_of_its_set_points():
    trace = Trace()
    assert trace.arrived(None) is None
    trace.hand_over(100, 70, 104)
    assert trace.arrived(Acted(99, 105, 106)) is None
    assert trace.arrived(Acted(100, 117, 119)) is not None


@given(st.sets(st.integers(0, 400)))
def test_every_set_point_that_the_link_acted_on_is_told_once_and_no_other(acted_on):
    """One set-point a tick; the link has acted on some of them, and says so at every tick until the next."""
    trace, told, acted = Trace(), [], None
    for tick in range(400):
        if arrival := trace.arrived(acted):
            told.append(arrival.sensor_to_wire_ms)
        trace.hand_over(tick, tick * MS, tick * MS)
        if tick in acted_on:
            acted = Acted(tick, tick * MS, (2 * tick + 1) * MS)
    assert told == [tick + 1.0 for tick in sorted(acted_on) if tick < 399]
