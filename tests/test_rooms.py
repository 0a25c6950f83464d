"""The wall between what drives a robot and what simulates it, as a run without --sitl meets it.

The imports themselves are checked by import-linter (pyproject.toml); this is what is left in memory.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = ("adapter", "protocol", "sim")
ON_ROBOTS = {"quadruped": ("robot",)}
"""Rooms of those that ship what runs on a robot."""
FILES = (
    *("platform.py", "adapter/adapter.py", "adapter/preflight.py", "adapter/transport.py"),
    *("protocol/connection.py", "sim/sitl.py", "sim/simulator.py", "sim/dynamics.py", "sim/settings.py"),
)
"""A reader who knows one robot finds them in every other."""

LOADED = """
import json, sys
from adatracker_deploy.registry import load_platform, load_profile
load_profile(load_platform("{name}").default_profile)
print(json.dumps([name for name in sys.modules if name.startswith("adatracker_")]))
"""


@pytest.mark.parametrize("name", ["drone", "quadruped", "ros2", "wheeled"])
def test_a_robot_is_found_and_described_without_its_simulator(name):
    done = subprocess.run(
        [sys.executable, "-c", LOADED.format(name=name)], check=True, capture_output=True, text=True
    )
    loaded = set(json.loads(done.stdout))
    own = {module for module in loaded if module.startswith(f"adatracker_{name}.sim")}
    assert f"adatracker_{name}.adapter.adapter" in loaded
    assert own == {f"adatracker_{name}.sim", f"adatracker_{name}.sim.settings"}
    assert "adatracker_deploy.sim.world" not in loaded
    assert not [module for module in loaded if module.startswith("adatracker_deploy.faults")]


@pytest.mark.parametrize("robot", ["drone", "quadruped", "ros2", "wheeled"])
def test_every_robot_has_the_same_rooms_and_files(robot):
    package = ROOT / "platforms" / f"adatracker_{robot}"
    assert sorted(
        path.name for path in package.iterdir() if path.is_dir() and path.name != "__pycache__"
    ) == sorted((*ROOMS, *ON_ROBOTS.get(robot, ())))
    assert not [name for name in FILES if not (package / name).is_file()]
    assert (package / "py.typed").is_file()
