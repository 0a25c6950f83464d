"""The built wheel works outside the checkout, with its profiles and bundles inside it."""

from __future__ import annotations

import json
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    """The command of a wheel installed into a virtual environment that borrows the tests' dependencies."""
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", folder, ROOT],
        check=True,
    )
    (wheel,) = folder.glob("*.whl")
    environment = folder / "environment"
    venv.create(environment, with_pip=False, symlinks=True)
    scheme = {"base": str(environment), "platbase": str(environment)}
    site = Path(sysconfig.get_path("purelib", "venv", scheme))
    install = [sys.executable, "-m", "pip", "--python", environment / "bin" / "python", "install"]
    subprocess.run([*install, "-q", "--no-deps", "--no-index", wheel], check=True)
    # Everything but this project, whose editable install must not be found, is there as if installed.
    for entry in Path(sysconfig.get_path("purelib")).iterdir():
        if "adatracker" not in entry.name and entry.suffix != ".pth" and not (site / entry.name).exists():
            (site / entry.name).symlink_to(entry)
    return environment / "bin" / "adatracker-deploy"


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
