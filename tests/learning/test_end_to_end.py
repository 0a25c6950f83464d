"""The whole way, tiny: collect, train, export, evaluate, each by its command."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]


def ran(folder, *command):
    done = subprocess.run(
        [sys.executable, *map(str, command)], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_policy_is_collected_for_trained_exported_and_scored(tmp_path):
    deploy = ("-m", "adatracker_deploy")
    ran(tmp_path, *deploy, "collect", "--recipe", "deploy", "--steps", 1000, "--workers", 1, "--out", "data")
    sizes = ("--updates", 20, "--rounds", 1, "--round-steps", 300, "--batch", 4, "--threads", 1)
    trained = ran(tmp_path, *deploy, "train", "--recipe", "deploy", "--data", "data", "--out", "run", *sizes)
    assert trained.strip() == "run/policy.pt"
    ran(tmp_path, ROOT / "tools" / "export_onnx.py", "run/policy.pt", "--out", "bundle")
    scored = ran(
        tmp_path,
        *(*deploy, "evaluate", "--policy", "bundle", "--condition", "clean", "--json"),
        *("--episodes", 1, "--steps", 40, "--workers", 1),
    )
    ((name, policy),) = json.loads(scored)["policies"].items()
    assert name == "adatracker_dagger"
    assert len(policy["cells"]) == 16
    # 20 updates do not make a tracker; that it moves by its masks at all is for other tests.
    assert 0 < policy["mean"]["el"] <= 40
