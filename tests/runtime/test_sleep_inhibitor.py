"""A lock on sleep is held as long as the process that asked for it lives, where the system gives one."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import pytest

from adatracker_deploy.runtime.sleep_inhibitor import inhibited

SYSTEMD = """#!/bin/sh
# Takes systemd-inhibit's options; like logind without a seat it lets nobody lock the lid.
case "$1" in --what=*{refused}*) exit 1;; esac
echo "$1 $2 $3 $4" >> "{log}"
shift 4
"$@"
echo released >> "{log}"
"""


@pytest.fixture
def system(tmp_path, monkeypatch):
    """Put a systemd-inhibit before all others; return the file that tells what it was asked for."""

    def make(refused):
        log, command = tmp_path / "log", tmp_path / "systemd-inhibit"
        command.write_text(SYSTEMD.format(refused=refused, log=log))
        command.chmod(0o755)
        monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
        return log

    return make


def test_the_lock_is_held_and_given_back(system):
    log = system("nothing")
    with inhibited("a robot is driven") as kinds:
        assert kinds == "sleep:idle:handle-lid-switch"
        assert log.read_text() == (
            "--what=sleep:idle:handle-lid-switch --who=adatracker-deploy "
            "--why=a robot is driven --mode=block\n"
        )
    assert log.read_text().endswith("released\n")


def test_where_the_lid_cannot_be_locked_sleep_is(system):
    log = system("lid")
    with inhibited("a robot is driven") as kinds:
        assert kinds == "sleep:idle"
    assert log.read_text().count("--what=") == 1


def test_where_nothing_can_be_locked_that_is_told(system, monkeypatch, tmp_path):
    system("sleep")
    with inhibited("a robot is driven") as kinds:
        assert kinds == ""
    monkeypatch.setenv("PATH", str(tmp_path / "nothing"))
    with inhibited("a robot is driven") as kinds:
        assert kinds == ""


def test_whatever_ends_its_holder_gives_it_back(system):
    log = system("nothing")
    script = (
        "import os, signal\n"
        "from adatracker_deploy.runtime.sleep_inhibitor import inhibited\n"
        "with inhibited('a robot is driven'):\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    subprocess.run([sys.executable, "-c", script], check=False)
    while "released" not in log.read_text():
        threading.Event().wait(0.01)
