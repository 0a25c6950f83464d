"""A bell wakes whoever listens, and never makes the ringer wait; the link steps for it once a slot."""

from __future__ import annotations

import itertools
import multiprocessing
import threading
import time

import pytest

from adatracker_deploy.core.clock import FakeClock
from adatracker_deploy.runtime.bell import Bell, Ear
from adatracker_deploy.runtime.link import RATE_HZ
from adatracker_deploy.runtime.link_process import Slots

LONG_S = 60.0
PIPE_BYTES = 1 << 17


@pytest.fixture
def ends():
    reading, writing = multiprocessing.Pipe(duplex=False)
    with reading, writing:
        yield Bell(writing), Ear(reading)


def test_who_listens_wakes_at_once(ends):
    bell, ear = ends
    began_s = time.monotonic()
    threading.Timer(0.01, bell.ring).start()
    assert ear.heard(LONG_S)
    assert time.monotonic() - began_s < LONG_S / 2


def test_rings_before_are_heard_as_one(ends):
    bell, ear = ends
    for _ in range(3):
        bell.ring()
    assert ear.heard(0.0)
    assert not ear.heard(0.0)


def test_ringing_never_waits_for_who_does_not_listen(ends):
    bell, ear = ends
    for _ in range(PIPE_BYTES):
        bell.ring()
    assert ear.heard(0.0)


def test_who_listens_outlives_the_ringer(ends):
    bell, ear = ends
    bell.close()
    bell.close()
    bell.ring()
    assert not ear.heard(0.0)
    assert not ear.heard(0.0)


class Rung:
    """An ear that hears after so long each time, s; never where None."""

    def __init__(self, clock, after_s):
        self.clock, self.after_s = clock, after_s

    def heard(self, timeout_s):
        if self.after_s is None or self.after_s > timeout_s:
            return False
        self.clock.advance(self.after_s)
        return True


@pytest.mark.parametrize(("after_s", "between_ns"), [(0.0, 0), (0.005, 5_000_000)])
def test_the_link_steps_for_a_ring_once_between_two_slots(after_s, between_ns):
    clock, slot_ns = FakeClock(t_ns=0), round(1e9 / RATE_HZ)
    slots = Slots(clock, Rung(clock, after_s))
    assert [slots.wait() for _ in range(6)] == [
        step for slot in range(3) for step in (slot * slot_ns, slot * slot_ns + between_ns)
    ]


def test_without_a_ring_the_link_keeps_its_slots():
    clock = FakeClock(t_ns=0)
    slots = Slots(clock, Rung(clock, None))
    times = [slots.wait() for _ in range(5)]
    assert {after - before for before, after in itertools.pairwise(times)} == {round(1e9 / RATE_HZ)}
