"""All extras that a request lacks are named at once, in one command."""

from __future__ import annotations

import platform

import pytest

from adatracker_deploy.cli import extras, main
from adatracker_deploy.core.errors import UsageError

LINES = (
    "numpy>=1.26",
    "mavsdk==4.1.0; extra == 'drone'",
    'jsbsim>=1.2; extra == "sitl"',
    "mujoco>=3.2 ; extra == 'sitl'",
    "adatracker-deploy[zenoh]; extra == 'quadruped'",
    "rosbags>=0.11.9; extra == 'quadruped'",
    "eclipse-zenoh==1.10.2; extra == 'zenoh'",
    "other; platform_machine == 'pdp11' and extra == 'sitl'",
    f"here; platform_machine == '{platform.machine()}' and extra == 'here'",
)


def test_an_extra_needs_what_metadata_says_and_what_its_own_extras_need():
    assert extras.requirements(LINES, ["quadruped", "sitl", "here", "somebody-elses"]) == {
        "quadruped": ["eclipse-zenoh", "rosbags"],
        "sitl": ["jsbsim", "mujoco"],
        "here": ["here"],
        "somebody-elses": [],
    }


def test_what_is_there_is_not_asked_for(monkeypatch):
    monkeypatch.setattr(extras, "installed", lambda name: name != "mujoco")
    with pytest.raises(UsageError, match=r"^it needs mujoco: pip install 'adatracker-deploy\[sitl\]'$"):
        extras.need(["drone", "sitl"], "it")
    extras.need(["drone", "somebody-elses"], "it")


def test_a_package_of_ros_is_also_there_where_only_its_module_is(tmp_path, monkeypatch):
    """A sourced ROS 2 installation is on the path, and no distribution of pip's."""
    assert not extras.installed("ros-sourced-msgs")
    (tmp_path / "sourced_msgs.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    assert extras.installed("ros-sourced-msgs")
    assert not extras.installed("sourced-msgs")


def test_this_package_is_installed_and_a_package_that_nobody_has_is_not():
    assert extras.installed("numpy")
    assert not extras.installed("a-package-that-nobody-has")


@pytest.mark.parametrize(
    ("arguments", "asked"),
    [
        (["--platform", "drone", "--sitl"], "[drone,sitl]"),
        (["--platform", "wheeled,quadruped", "--sitl", "--live"], "[live,quadruped,sitl,wheeled]"),
        (["--platform", "drone", "--camera", "world://simple_room"], "[drone,world]"),
        (["--platform", "wheeled"], "[wheeled]"),
        (["--platform", "wheeled", "--policy", "ws://gpu:8000"], "[remote,wheeled]"),
        (["--platform", "wheeled", "--policy", "hf://lab/follower"], "[hub,wheeled]"),
        (["--platform", "wheeled", "--teleop"], "[teleop,wheeled]"),
        (["serve"], "[remote]"),
        (["doctor", "--platform", "ros2", "--sitl"], "[ros2,sitl]"),
    ],
)
def test_a_run_names_all_that_it_lacks(monkeypatch, capsys, arguments, asked):
    monkeypatch.setattr(extras, "installed", lambda name: False)
    assert main(arguments) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert f"pip install 'adatracker-deploy{asked}'" in err
