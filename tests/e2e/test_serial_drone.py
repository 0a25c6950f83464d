"""A Pixhawk on a companion's serial port: a whole trial over a pty pair, and the cable that is pulled."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys

import pytest
import yaml

from adatracker_deploy.registry import profile_dir
from adatracker_deploy.trial.reader import read_trial
from tests.by_hand import simulator_by_hand
from tests.drone.serial_cable import SerialCable

pytestmark = pytest.mark.slow


def test_a_drone_follows_over_a_serial_cable(tmp_path):
    document = yaml.safe_load((profile_dir() / "px4_quad.yaml").read_text(encoding="utf-8"))
    with (
        contextlib.closing(SerialCable()) as cable,
        simulator_by_hand(
            "adatracker_drone.sim.sitl",
            *("--port", str(cable.port), "--settings", json.dumps(document["sitl"])),
        ),
    ):
        document["connection"]["url"] = f"serial://{cable.device}:921600"
        profile = tmp_path / "pixhawk.yaml"
        profile.write_text(yaml.safe_dump(document), encoding="utf-8")
        done = subprocess.run(
            (
                *(sys.executable, "-m", "adatracker_deploy", "--platform", "drone"),
                *("--profile", str(profile), "--camera", "world://simple_room", "--segmenter", "truth"),
                *("--steps", "60", "--log-dir", str(tmp_path / "trials"), "--json"),
            ),
            capture_output=True,
            text=True,
            timeout=150,
            env={**os.environ, "COLUMNS": "200"},
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert cable.carried["to the autopilot"] > 60 * 50  # set-points of 60 steps
    (folder,) = (tmp_path / "trials").iterdir()
    trial = read_trial(folder)
    assert (trial.kind, trial.summary["outcome"]) == ("real", "completed")
    assert len(trial.steps) == 61
    assert any(step.sent and step.sent.vx > 0.1 for step in trial.steps)
    assert trial.config["profile"]["connection"]["url"].startswith("serial:///dev/")
