"""A Pixhawk on a companion's serial port: a whole trial over a pty pair, and the cable that is pulled."""

from __future__ import annotations

import contextlib
import json
import time

import pytest
import yaml

from adatracker_deploy.faults.matrix import STOPPED
from adatracker_deploy.registry import profile_dir
from adatracker_deploy.trial.reader import read_trial
from tests.by_hand import simulator_by_hand
from tests.drone.serial_cable import SerialCable
from tests.tiers import EXHAUSTIVE

from .conftest import COMMAND, Flight

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]
AUTOPILOTS_OWN_S = 3.0
"""PX4 waits 1 s for set-points (COM_OF_LOSS_T), stops and lands (`link_kill`, docs/safety.md)."""


@pytest.fixture
def cable(tmp_path, station):
    """A simulated Pixhawk behind a cable; its profile is written, and a ground station hears it by radio."""
    document = yaml.safe_load((profile_dir() / "px4_quad.yaml").read_text(encoding="utf-8"))
    document["sitl"]["gcs"] = f"udpout:127.0.0.1:{station.port}"
    with (
        contextlib.closing(SerialCable()) as cable,
        simulator_by_hand(
            "adatracker_drone.sim.sitl",
            *("--port", str(cable.port), "--settings", json.dumps(document["sitl"])),
        ),
    ):
        document["connection"]["url"] = f"serial://{cable.device}:921600"
        (tmp_path / "pixhawk.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
        yield cable


def flown(folder, steps):
    options = "--platform", "drone", "--profile", "pixhawk.yaml", "--camera", "world://simple_room"
    return Flight([*COMMAND, *options, "--segmenter", "truth", "--steps", str(steps), "--json"], folder)


@EXHAUSTIVE
def test_a_drone_follows_over_a_serial_cable(cable, tmp_path):
    status, _, err = flown(tmp_path, 60).end(timeout_s=150)
    assert status == 0, err
    assert cable.carried["to the autopilot"] > 60 * 50  # set-points of 60 steps
    (folder,) = (tmp_path / "trials").iterdir()
    trial = read_trial(folder)
    assert (trial.kind, trial.summary["outcome"]) == ("real", "completed")
    assert len(trial.steps) == 61
    assert any(step.sent and step.sent.vx > 0.1 for step in trial.steps)
    assert trial.config["profile"]["connection"]["url"].startswith("serial:///dev/")


@EXHAUSTIVE
def test_a_cable_that_is_pulled_ends_the_trial_and_the_autopilot_lands_by_itself(
    cable, station, tmp_path, measured
):
    flight = flown(tmp_path, 100_000)
    station.wait_until_flying(0.5)
    onset_s = time.monotonic()
    cable.pull()
    halted_s, down_s = station.wait_until_halted(onset_s), station.wait_until_down(onset_s)
    status, summary, err = flight.end(timeout_s=60)
    measured(f"drone, serial cable pulled: below 0.3 m/s after {halted_s:.2f} s, down after {down_s:.1f} s")
    assert status == 1, err
    assert summary["outcome"] in STOPPED, err  # whether the loop or the link is the first to miss the drone
    assert "from the drone" in summary["reason"]
    assert halted_s < AUTOPILOTS_OWN_S
