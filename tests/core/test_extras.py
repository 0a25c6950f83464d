"""All extras that a request lacks are named at once, in one command."""

from __future__ import annotations

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
)


def test_an_extra_needs_what_metadata_says_and_what_its_own_extras_need():
    assert extras.requirements(LINES, ["quadruped", "sitl", "somebody-elses"]) == {
        "quadruped": ["rosbags", "eclipse-zenoh"],
        "sitl": ["jsbsim", "mujoco"],
        "somebody-elses": [],
    }


def test_what_is_there_is_not_asked_for(monkeypatch):
    monkeypatch.setattr(extras, "installed", lambda name: name != "mujoco")
    with pytest.raises(UsageError, match=r"^it needs mujoco: pip install 'adatracker-deploy\[sitl\]'$"):
        extras.need(["drone", "sitl"], "it")
    extras.need(["drone", "somebody-elses"], "it")


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
        (["serve"], "[remote]"),
    ],
)
def test_a_run_names_all_that_it_lacks(monkeypatch, capsys, arguments, asked):
    monkeypatch.setattr(extras, "installed", lambda name: False)
    assert main(arguments) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert f"pip install 'adatracker-deploy{asked}'" in err
