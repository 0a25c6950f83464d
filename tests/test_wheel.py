"""The built wheel works outside the checkout, with its profiles and bundles inside it."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from tests.installed import ROOT, install_wheel
from tests.tiers import EXHAUSTIVE


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    """The command of a wheel installed into a virtual environment that borrows the tests' dependencies."""
    return install_wheel(tmp_path_factory.mktemp("wheel")) / "bin" / "adatracker-deploy"


def run(command: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [command, *arguments], check=False, cwd=folder, capture_output=True, text=True, timeout=120
    )


@pytest.mark.slow
def test_the_wheel_knows_its_platforms_profiles_and_policies(command, tmp_path):
    for what, name in (("platforms", "drone"), ("profiles", "px4_quad"), ("policies", "pid")):
        done = run(command, tmp_path, what, "--json")
        assert done.returncode == 0, done.stderr
        assert name in json.loads(done.stdout)[what]


@pytest.mark.slow
def test_the_wheel_has_foxgloves_layout(command, tmp_path):
    done = run(command, tmp_path, "layout")
    assert done.returncode == 0, done.stderr
    assert "configById" in json.loads(done.stdout)


@EXHAUSTIVE
@pytest.mark.slow
def test_the_wheel_rehearses(command, tmp_path):
    profile = tmp_path / "here.yaml"
    shown = run(command, tmp_path, "profiles", "--json")
    assert str(ROOT) not in shown.stdout
    profile.write_text(
        next((command.parents[1]).rglob("calib-free-profiles/px4_quad.yaml"))
        .read_text()
        .replace(":14540", ":0")
    )
    done = run(
        command,
        tmp_path,
        *(
            "--platform",
            "drone",
            "--sitl",
            "--segmenter",
            "truth",
            "--profile",
            str(profile),
            "--steps",
            "20",
            "--speed",
            "2",
            "--json",
        ),
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1])["outcome"] == "completed"
