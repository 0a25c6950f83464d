"""One line gives a whole rehearsal: take-off, following, landing, a scored log."""

from __future__ import annotations

import json

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]


@pytest.mark.parametrize("speed", ["1", "3"])
def test_a_drone_follows_to_the_horizon_and_lands(fly, station, tmp_path, measured, speed):
    flight = fly("--seed", "1", "--steps", "400", "--json", "--speed", speed)
    status, summary, err = flight.end(timeout_s=200)
    assert status == 0, err
    assert summary["outcome"] == "completed"
    assert summary["el"] == 400
    assert summary["mr"] >= 0.75
    assert station.landed
    assert station.armed is False
    assert "airborne" in err
    (folder,) = (tmp_path / "trials").iterdir()
    assert json.loads((folder / "summary.json").read_text())["mr"] == summary["mr"]
    mr, ar, rate_hz = summary["mr"], summary["ar"], summary["rate_hz"]
    measured(f"drone x{speed}: MR {mr:.3f}, AR {ar:.0f}, {rate_hz:.2f} Hz")


def test_several_trials_print_the_papers_row(fly):
    flight = fly("--trials", "2", "--steps", "60", "--speed", "4", "--json")
    status, summary, err = flight.end(timeout_s=200)
    assert status == 0, err
    assert len(summary["trials"]) == 2
    assert set(summary["mean"]) >= {"mr", "el", "sr"}
    assert "±" in err
