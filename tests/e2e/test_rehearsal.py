"""One line gives a whole rehearsal: take-off, following, landing, a scored log."""

from __future__ import annotations

import json
import time

import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.policy.catalogue import DEFAULT, load_policy
from adatracker_deploy.trial.reader import read_trial
from tests.policy.servers import serving
from tests.tiers import EXHAUSTIVE

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]


@EXHAUSTIVE
@pytest.mark.parametrize("speed", [pytest.param("1", marks=EXHAUSTIVE), "3"])
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


@EXHAUSTIVE  # all three robots do, in test_ground_rehearsal
def test_several_trials_print_the_papers_row(fly):
    flight = fly("--trials", "2", "--steps", "60", "--speed", "4", "--json")
    status, summary, err = flight.end(timeout_s=200)
    assert status == 0, err
    assert len(summary["trials"]) == 2
    assert set(summary["mean"]) >= {"mr", "el", "sr"}
    assert "±" in err


@EXHAUSTIVE
def test_a_drone_whose_policys_server_is_killed_halts_and_lands(fly, station, tmp_path, measured):
    with serving(DEFAULT) as (server, uri):
        flight = fly("--seed", "1", "--steps", "2000", "--json", "--policy", uri)
        station.wait_until_flying(0.5)
        onset_s = time.monotonic()
        server.kill()
        halted_s, down_s = station.wait_until_halted(onset_s), station.wait_until_down(onset_s)
        status, summary, err = flight.end()
    measured(
        f"drone, policy's server killed: below 0.3 m/s after {halted_s:.2f} s, down after {down_s:.1f} s"
    )
    assert (status, summary["outcome"]) == (1, "system_fault"), err
    assert "the server is gone" in summary["reason"]
    assert halted_s < 2.5
    (folder,) = (tmp_path / "trials").iterdir()
    trial = read_trial(folder)
    assert trial.config["policy_server"] == uri
    assert trial.config["policy_sha256"] == dict(load_policy(DEFAULT).info.sha256)
    assert all(step.latency.answer_age_ms < 220 for step in trial.steps if step.action)
    assert main(["report", str(folder), "--out", str(tmp_path / "page.html")]) == 0
    assert "round trip" in (tmp_path / "page.html").read_text()
    assert main(["replay", str(folder)]) == 0  # by the same bundle, in this process
