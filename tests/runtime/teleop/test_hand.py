"""A tick takes exactly the events up to its own time, from a device as from its recording."""

from __future__ import annotations

import os
import threading

from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.core.clock import FakeClock, MonotonicClock
from adatracker_deploy.runtime.teleop.device import reading
from adatracker_deploy.runtime.teleop.hand import Hand
from adatracker_deploy.runtime.teleop.takeover import AXES, CODES, InputEvent

MS = 1_000_000


def silent():
    raise AssertionError("nobody asked to stop")


def test_an_event_between_two_ticks_is_the_later_ones():
    clock = FakeClock()
    hand = Hand(clock, silent)
    assert not hand.at(clock.now_ns()).drives
    clock.advance(0.01)
    tick_ns = clock.now_ns()
    clock.advance(0.001)
    hand.put(("forward", 0.5), ("dead_man", 1.0))
    assert not hand.at(tick_ns).drives
    assert hand.at(tick_ns + MS).values == (0.5, 0.0, 0.0, 0.0)
    assert [event.t_ns for event in hand.events] == [11 * MS, 11 * MS]


def test_when_the_hold_ends_is_told_on_the_clock_of_the_run():
    clock = FakeClock()
    hand = Hand(clock, silent)
    hand.at(clock.now_ns())
    clock.advance(0.001)
    hand.put(("dead_man_s", 0.15))
    assert hand.at(clock.now_ns()).held_until_ns == clock.now_ns() + 150 * MS
    clock.advance(0.2)
    assert hand.at(clock.now_ns()).held_until_ns == clock.now_ns()


def test_stop_asks_once_at_once_from_a_device_and_at_its_time_from_a_recording():
    clock, asked = FakeClock(), []
    hand = Hand(clock, lambda: asked.append("device"))
    hand.put(("stop", 1.0))  # before any tick: a drone may be climbing
    hand.put(("stop", 1.0))
    hand.at(clock.now_ns())
    assert asked == ["device"]
    recorded = Hand(clock, lambda: asked.append("recording"), recorded=(InputEvent(5 * MS, "stop"),))
    recorded.at(clock.now_ns())
    assert asked == ["device"]
    recorded.at(clock.now_ns() + 5 * MS)
    recorded.at(clock.now_ns() + 6 * MS)
    assert asked == ["device", "recording"]


TOLD = st.tuples(
    st.integers(0, 40), st.sampled_from([code for code in CODES if code != "stop"]), st.floats(0, 1)
)


@settings(max_examples=50)
@given(st.lists(st.one_of(st.integers(1, 60), st.lists(TOLD, min_size=1, max_size=3)), max_size=40))
def test_a_recording_asks_for_the_same_as_the_device_at_every_tick(course):
    """A course of pauses before ticks, ms, and of what a device tells between them."""
    clock, ticks, asked = FakeClock(), [], []
    hand = Hand(clock, silent)
    for item in [5, *course, 5]:
        if isinstance(item, int):
            clock.advance(item / 1e3)
            ticks.append(clock.now_ns())
            asked.append(hand.at(ticks[-1]))
        else:
            for pause, code, value in item:
                clock.advance(pause / 1e3)
                hand.put((code, -value if code in AXES else value))
    again = Hand(FakeClock(), silent, recorded=hand.events)
    assert repr([again.at(tick) for tick in ticks]) == repr(asked)


def test_a_device_that_ends_or_fails_is_gone():
    for fails in (EOFError, OSError(19, "No such device"), ZeroDivisionError):
        came, (end, ender) = threading.Event(), os.pipe()
        hand = Hand(MonotonicClock(), silent)

        def put(*events, hand=hand, came=came):
            hand.put(*events)
            came.set()

        def read(fails=fails):
            raise fails

        assert not hand.gone
        with reading(end, read, put):
            os.write(ender, b"x")
            assert came.wait(10)
        assert hand.gone
        os.close(end)
        os.close(ender)
