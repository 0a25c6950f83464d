"""The link halts and lands the drone if the tracker dies or hangs in flight; a listener on its wire checks.

The fault matrix injects all other faults, and reads the simulator's own record.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

import pytest

from tests.tiers import EXHAUSTIVE

from .conftest import gone

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]

FAST_M_S = 0.8
HALT_LIMIT_S = 3.0
"""Link time-out 0.2 s and hold 0.5 s, an F450's braking from 1 m/s about 1 s, two busy cores the rest."""
DOWN_LIMIT_S = 20.0


def halted(station, onset_s, measured, what: str) -> None:
    halted_s, down_s = station.wait_until_halted(onset_s), station.wait_until_down(onset_s)
    measured(
        f"drone at 1 m/s, {what}: halted after {halted_s:.2f} s, landed and disarmed after {down_s:.1f} s"
    )
    assert halted_s < HALT_LIMIT_S
    assert down_s < DOWN_LIMIT_S


@EXHAUSTIVE
def test_a_tracker_that_dies_at_1_m_s_is_halted_and_landed_by_the_link(fly, station, measured):
    flight = fly("--steps", "2000", "--seed", "3")
    station.wait_until_flying(FAST_M_S)
    link = flight.link_pid()
    onset_s = time.monotonic()
    os.kill(flight.pid, signal.SIGKILL)
    halted(station, onset_s, measured, "tracker, kill -9")
    deadline_s = time.monotonic() + 20
    while not gone(link):
        assert time.monotonic() < deadline_s, "the link did not end after the landing"


@EXHAUSTIVE  # and a row of the fault matrix, in its everyday sample
def test_a_tracker_whose_thread_hangs_at_1_m_s_is_halted_and_landed_by_the_link(fly, station, measured):
    hanging = [sys.executable, str(Path(__file__).with_name("hanging_tracker.py"))]
    flight = fly("--steps", "2000", "--seed", "3", command=hanging)
    assert any(line.strip() == "hung" for line in flight.process.stdout)
    onset_s = time.monotonic()
    assert station.samples[-1].speed_m_s > FAST_M_S / 2
    halted(station, onset_s, measured, "tracker, Python thread hung")
