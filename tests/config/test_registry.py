"""Robots are found by name, and a missing extra is named with what to install."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint

import pytest

from adatracker_deploy import registry
from adatracker_deploy.cli import main
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.registry import load_platform, load_profile, platform_names
from adatracker_deploy.testing.fake import FakePlatform


def without(monkeypatch, library: str) -> None:
    """Let `import library` fail as if it were not installed, and forget who has imported it."""
    for name in list(sys.modules):
        if name.split(".")[0] in (library, "adatracker_drone"):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, library, None)


def test_the_drone_is_installed_and_says_what_it_can_follow():
    assert "drone" in platform_names()
    assert load_platform("drone").axes >= {"vx", "yaw_rate"}


def test_a_robot_whose_library_is_missing_names_its_extra(monkeypatch):
    without(monkeypatch, "mavsdk")
    with pytest.raises(UsageError, match=r"needs mavsdk: pip install 'adatracker-deploy\[drone\]'"):
        load_platform("drone")


@pytest.mark.parametrize(("library", "extra"), [("mujoco", "world"), ("jsbsim", "sitl")])
def test_a_rehearsal_without_a_simulator_names_the_extra(monkeypatch, capsys, tmp_path, library, extra):
    without(monkeypatch, library)
    assert main(["--platform", "drone", "--sitl", "--log-dir", str(tmp_path / "trials")]) == 2
    *_, line = capsys.readouterr().err.strip().splitlines()
    assert f"needs {library}: pip install 'adatracker-deploy[{extra}]'" in line
    assert not (tmp_path / "trials").exists()


def test_a_profile_of_another_robot_is_refused():
    with pytest.raises(UsageError, match="is a profile for platform 'drone', not 'fake'"):
        load_profile("px4_quad", FakePlatform)


def register(monkeypatch, value: str) -> None:
    """Let a package from outside name `value` as its robot."""
    point = EntryPoint("rover", value, registry.ENTRY_POINT_GROUP)
    monkeypatch.setattr(registry, "entry_points", lambda group: [point])


def test_a_robot_from_outside_whose_library_is_missing_names_the_library(monkeypatch):
    register(monkeypatch, "a_library_that_nobody_has.platform:Rover")
    with pytest.raises(UsageError, match="needs a_library_that_nobody_has: pip install a_library_that_nob"):
        load_platform("rover")


@pytest.mark.parametrize(
    "value", ["adatracker_deploy.testing.fake:FakeRover", "adatracker_deploy.core.errors:UsageError"]
)
def test_an_entry_point_that_leads_to_no_robot_is_named(monkeypatch, value):
    register(monkeypatch, value)
    with pytest.raises(UsageError, match=f"platform 'rover': {value}"):
        load_platform("rover")
