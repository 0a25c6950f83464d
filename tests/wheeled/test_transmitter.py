"""The transmitter sends the newest command for its lifetime, then three zeros, then nothing."""

import contextlib
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from wheeled_rig import until

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_wheeled.adapter.transmitter import Stream, Transmitter

PERIOD_S, LIFETIME_S = 0.02, 0.2
AHEAD, TURN = Twist(vx=0.5), Twist(yaw_rate=0.5)


def stream():
    return Stream(lifetime_ns=100)


def slots(stream, *times_ns):
    return [stream.next(t_ns) for t_ns in times_ns]


def test_it_is_silent_until_there_is_a_command():
    assert slots(stream(), 0, 1, 2) == [None, None, None]


def test_a_command_is_repeated_for_its_lifetime_then_zero_three_times_then_nothing():
    one = stream()
    one.offer(AHEAD, 0)
    assert slots(one, 0, 50, 100, 101, 102, 103, 104) == [AHEAD, AHEAD, AHEAD, ZERO, ZERO, ZERO, None]
    assert one.lapses == 1


def test_only_the_newest_command_goes_out():
    one = stream()
    one.offer(AHEAD, 0)
    one.offer(TURN, 1)
    assert slots(one, 2, 3) == [TURN, TURN]


def test_a_stop_says_zero_three_times_also_when_nothing_went_out_before():
    for started in (False, True):
        one = stream()
        if started:
            one.offer(AHEAD, 0)
        one.stop()
        assert slots(one, 1, 2, 3, 4) == [ZERO, ZERO, ZERO, None]
        assert one.silent


def test_a_muted_stream_says_not_even_zero():
    one = stream()
    one.offer(AHEAD, 0)
    one.mute()
    assert slots(one, 1, 2) == [None, None]


@given(
    st.lists(st.sampled_from(["offer", "stop", "mute", "wait"]), max_size=40),
    st.integers(1, 60),
)
def test_nothing_but_zero_goes_out_once_a_command_is_too_old_or_stopped(acts, step_ns):
    one, now_ns, last_ns = stream(), 0, None
    for act in acts:
        now_ns += step_ns
        if act == "offer":
            one.offer(AHEAD, now_ns)
            last_ns = now_ns
        elif act != "wait":
            getattr(one, act)()
            last_ns = None
        alive = last_ns is not None and now_ns - last_ns <= 100
        assert (one.next(now_ns) == AHEAD) == alive


class Wire:
    """Records each twist sent, and when."""

    def __init__(self):
        self.sent = []
        self.broken = False

    def __call__(self, twist):
        if self.broken:
            raise PlatformError("gone")
        self.sent.append((time.monotonic(), twist))

    @property
    def twists(self):
        return [twist for _, twist in self.sent]


@pytest.fixture
def wire():
    return Wire()


@pytest.fixture
def transmitter(wire):
    with contextlib.closing(Transmitter(wire, MonotonicClock(), PERIOD_S, LIFETIME_S)) as transmitter:
        yield transmitter


def now_ns():
    return MonotonicClock().now_ns()


def test_the_first_command_waits_for_no_period(wire, transmitter):
    began_s = time.monotonic()
    transmitter.send(AHEAD, now_ns())
    until(lambda: wire.sent)
    assert wire.sent[0][0] - began_s < PERIOD_S / 2


def test_a_caller_that_hangs_is_not_kept_alive(wire, transmitter):
    transmitter.send(AHEAD, now_ns())
    began_s = time.monotonic()
    assert transmitter.wait_until_silent(5.0)
    assert time.monotonic() - began_s < LIFETIME_S + 5 * PERIOD_S + 0.1
    assert wire.twists[-3:] == [ZERO] * 3
    assert AHEAD in wire.twists
    assert transmitter.lapses == 1
    count = len(wire.sent)
    threading.Event().wait(3 * PERIOD_S)
    assert len(wire.sent) == count


def test_a_command_from_long_ago_never_goes_out(wire, transmitter):
    transmitter.send(AHEAD, now_ns() - round(2 * LIFETIME_S * 1e9))
    assert transmitter.wait_until_silent(5.0)
    assert set(wire.twists) == {ZERO}


def test_a_caller_that_is_too_fast_does_not_flood_the_bus(wire, transmitter):
    pause, end_s = threading.Event(), time.monotonic() + 0.5
    while time.monotonic() < end_s:
        transmitter.send(AHEAD, now_ns())
        pause.wait(0.0005)
    assert 0.5 / PERIOD_S * 0.7 < len(wire.sent) < 0.5 / (PERIOD_S / 2) + 3
    gaps = [after - before for (before, _), (after, _) in zip(wire.sent, wire.sent[1:], strict=False)]
    assert sorted(gaps)[len(gaps) // 2] > PERIOD_S / 2 - 0.002


def test_a_caller_at_the_bases_own_period_waits_for_little(wire, transmitter):
    clock, start_ns, waited = MonotonicClock(), now_ns(), []
    for tick in range(50):
        clock.sleep_until(start_ns + tick * round(PERIOD_S * 1e9))
        transmitter.send(AHEAD, clock.now_ns())
        count = len(wire.sent)
        until(lambda count=count: len(wire.sent) > count)
        waited.append(transmitter.latency_s)
    print(f"send to wire: median {sorted(waited)[25] * 1e3:.2f} ms")
    assert sorted(waited)[25] < 0.005


def test_a_stop_goes_out_at_once_and_three_times(wire, transmitter):
    transmitter.send(AHEAD, now_ns())
    until(lambda: wire.sent)
    began_s = time.monotonic()
    transmitter.stop()
    until(lambda: wire.twists[-1] == ZERO)
    assert time.monotonic() - began_s < PERIOD_S
    assert transmitter.wait_until_silent(5.0)
    assert wire.twists[-3:] == [ZERO] * 3
    assert AHEAD not in wire.twists[-3:]


def test_after_mute_has_returned_nothing_goes_out(wire, transmitter):
    for _ in range(20):
        transmitter.send(AHEAD, now_ns())
        transmitter.mute()
        count = len(wire.sent)
        threading.Event().wait(PERIOD_S / 4)
        assert len(wire.sent) == count


def test_a_wire_that_breaks_silences_it_and_harms_nobody(wire, transmitter):
    wire.broken = True
    transmitter.send(AHEAD, now_ns())
    assert transmitter.wait_until_silent(5.0)
    wire.broken = False
    transmitter.send(TURN, now_ns())
    until(lambda: wire.twists)
    assert wire.twists[0] == TURN


def test_a_closed_one_says_nothing_more_and_can_be_closed_again(wire, transmitter):
    transmitter.send(AHEAD, now_ns())
    transmitter.close()
    count = len(wire.sent)
    transmitter.close()
    transmitter.send(AHEAD, now_ns())
    threading.Event().wait(2 * PERIOD_S)
    assert len(wire.sent) == count
