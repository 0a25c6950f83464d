"""Whatever dies in flight, the drone halts and lands; the times are printed."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

import pytest

from .conftest import gone

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]

FAST_M_S = 0.8
HALT_LIMIT_S = 3.0
"""Link time-out 0.2 s and hold 0.5 s, an F450's braking from 1 m/s about 1 s, two busy cores the rest."""
DOWN_LIMIT_S = 20.0


def show(measured, what: str, halted_s: float, down_s: float) -> None:
    measured(
        f"drone at 1 m/s, {what}: halted after {halted_s:.2f} s, landed and disarmed after {down_s:.1f} s"
    )


def strike_and_watch(measured, what, station, strike):
    station.wait_until_flying(FAST_M_S)
    onset_s = time.monotonic()
    strike()
    halted_s = station.wait_until_halted(onset_s)
    down_s = station.wait_until_down(onset_s)
    show(measured, what, halted_s, down_s)
    assert halted_s < HALT_LIMIT_S
    assert down_s < DOWN_LIMIT_S


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["kill -9", "SIGSTOP"])
def test_a_tracker_that_dies_or_stops_at_1_m_s_is_halted_and_landed_by_the_link(
    fly, station, measured, number
):
    flight = fly("--steps", "2000", "--seed", "3")
    station.wait_until_flying(FAST_M_S)
    link = flight.link_pid()
    strike_and_watch(measured, f"tracker, {number.name}", station, lambda: os.kill(flight.pid, number))
    if number is signal.SIGKILL:
        deadline_s = time.monotonic() + 20
        while not gone(link):
            assert time.monotonic() < deadline_s, "the link did not end after the landing"


def test_a_tracker_whose_thread_hangs_at_1_m_s_is_halted_and_landed_by_the_link(fly, station, measured):
    hanging = [sys.executable, str(Path(__file__).with_name("hanging_tracker.py"))]
    flight = fly("--steps", "2000", "--seed", "3", command=hanging)
    assert any(line.strip() == "hung" for line in flight.process.stdout)
    onset_s = time.monotonic()
    assert station.samples[-1].speed_m_s > FAST_M_S / 2
    halted_s, down_s = station.wait_until_halted(onset_s), station.wait_until_down(onset_s)
    show(measured, "tracker, Python thread hung", halted_s, down_s)
    assert halted_s < HALT_LIMIT_S
    assert down_s < DOWN_LIMIT_S


def test_when_the_link_is_killed_the_autopilots_fail_safe_halts_and_lands(fly, station, measured):
    flight = fly("--steps", "2000", "--seed", "3", "--json")
    station.wait_until_flying(FAST_M_S)
    link = flight.link_pid()
    strike_and_watch(measured, "link, kill -9", station, lambda: os.kill(link, signal.SIGKILL))
    status, summary, _ = flight.end()
    assert status == 1
    assert summary["outcome"] == "system_fault"
    assert "link process died" in summary["reason"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["Ctrl-C", "SIGTERM"])
def test_an_interrupted_flight_lands_and_keeps_its_log(fly, station, measured, tmp_path, number):
    flight = fly("--steps", "2000", "--seed", "3", "--json")
    strike_and_watch(measured, number.name, station, lambda: os.kill(flight.pid, number))
    status, summary, _ = flight.end()
    assert status == 130
    assert summary["outcome"] == "interrupted"
    (folder,) = (tmp_path / "trials").iterdir()
    assert {path.name for path in folder.iterdir()} >= {"trial.mcap", "summary.json", "config.yaml"}


def test_ctrl_c_during_take_off_lands_too(fly, station):
    flight = fly("--steps", "2000", "--json")
    station.wait(lambda s: s.samples and s.samples[-1].altitude_m > 0.5, 60, "takes off")
    os.kill(flight.pid, signal.SIGINT)
    status, summary, _ = flight.end()
    assert status == 130
    assert summary["outcome"] == "interrupted"
    assert station.landed
    assert station.armed is False
