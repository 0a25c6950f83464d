"""Trials are found by who may stop them, and nothing else is taken for one."""

from __future__ import annotations

import dataclasses
import os

import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.runtime import running as module
from adatracker_deploy.runtime.running import PLACE_VARIABLE, Announcement, running


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    monkeypatch.setenv(PLACE_VARIABLE, str(tmp_path))
    return tmp_path


def test_a_trial_is_named_by_its_platform_process_and_log(tmp_path):
    announcement = Announcement("wheeled,drone")
    announcement.logging(tmp_path / "trials" / "first")
    announcement.logging(tmp_path / "trials" / "second")
    (one,) = running()
    for name in ("wheeled", "drone", str(os.getpid()), "second", str(tmp_path / "trials" / "second")):
        assert one.is_meant(name)
    for name in ("quadruped", "1", "first", ""):
        assert not one.is_meant(name)
    assert not one.stopping
    announcement.stopping()
    assert running()[0].stopping
    announcement.close()
    assert running() == ()


def test_a_named_robot_is_found_by_its_name_too():
    announcement = Announcement("wheeled", "left")
    (one,) = running()
    assert one.name == "left"
    assert one.is_meant("left")
    assert one.is_meant("wheeled")
    assert not one.is_meant("right")
    announcement.close()


def test_a_users_file_cannot_name_somebody_elses_process(tmp_path, monkeypatch):
    stranger = tmp_path / f"adatracker-deploy-{os.getuid() + 1}"
    stranger.mkdir()
    (stranger / str(os.getpid())).write_text(f"{module._began(os.getpid())}\nwheeled\n")
    assert running() == ()
    monkeypatch.setattr(module, "_is_sound", lambda *_: True)  # as if the folder were that user's own
    assert running() == ()
    assert list(stranger.iterdir())  # and not ours to tidy up


def test_anothers_trial_is_told_and_left_to_them(monkeypatch, capsys):
    theirs = dataclasses.replace(a_running(), user=os.getuid() + 1)
    monkeypatch.setattr(module, "running", lambda: (theirs,))
    monkeypatch.setattr("os.getuid", lambda: 1000)
    monkeypatch.setattr("os.kill", lambda *_: pytest.fail("told"))
    assert main(["stop"]) == 1
    assert "is another user's: stop it as " in capsys.readouterr().out


def a_running():
    announcement = Announcement("wheeled")
    (one,) = running()
    announcement.close()
    return one
