"""The files that deploy/ installs fit the toolkit, and a trial runs and stops as its systemd unit says."""

from __future__ import annotations

import configparser
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from adatracker_deploy.cli import _parser
from adatracker_deploy.runtime.pulse import SILENT_S
from adatracker_deploy.runtime.scheduling import LINK_PRIORITY, MEND_AWAKE_RULE
from adatracker_deploy.runtime.service_watchdog import PERIOD_VARIABLE, SOCKET_VARIABLE
from adatracker_deploy.trial.reader import read_trial
from tests.tiers import EXHAUSTIVE

DEPLOY = Path(__file__).parents[1] / "deploy"
UNITS = sorted((DEPLOY / "systemd").glob("*.service"))


def section(unit, name):
    """Return a section of a unit, less the keys that occur several times."""
    parsed = configparser.ConfigParser(strict=False, interpolation=None)
    parsed.optionxform = str
    parsed.read_string(unit.read_text())
    return parsed[name]


@pytest.fixture
def installed(tmp_path):
    subprocess.run(
        [DEPLOY / "install.sh", "--system"], check=True, env={**os.environ, "DESTDIR": str(tmp_path)}
    )
    return tmp_path / "etc"


def arguments(environment_file):
    (line,) = [line for line in environment_file.read_text().splitlines() if not line.startswith("#")]
    return line.removeprefix("ADATRACKER_ARGS=").split()


def test_the_system_files_are_installed_and_a_robots_own_settings_kept(installed):
    assert {unit.name for unit in UNITS} == {path.name for path in (installed / "systemd/system").iterdir()}
    args = _parser(with_commands=False).parse_args(arguments(installed / "adatracker/robot.env"))
    assert (args.platform, args.realtime, args.sitl, args.on_hangup) == ("wheeled", True, False, "stop")
    (installed / "adatracker/robot.env").write_text("ADATRACKER_ARGS=--platform drone\n")
    test_env = {**os.environ, "DESTDIR": str(installed.parent)}
    subprocess.run([DEPLOY / "install.sh", "--system"], check=True, env=test_env)
    assert arguments(installed / "adatracker/robot.env") == ["--platform", "drone"]


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here")
@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_systemd_finds_nothing_wrong_with_the_units(unit, tmp_path):
    text = (
        unit.read_text()
        .replace("/opt/adatracker/bin/adatracker-deploy", "/bin/true")
        .replace("/sbin/ip", "/bin/true")
    )
    (tmp_path / unit.name).write_text(text)
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", tmp_path / unit.name],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_the_trials_unit_leaves_the_link_to_bring_the_robot_to_rest():
    service = section(DEPLOY / "systemd/adatracker@.service", "Service")
    assert service["KillMode"] == "process"  # else systemd would kill the link with its tracker
    assert service["Restart"] == "no"  # nothing moves again by itself
    assert (service["Type"], service["NotifyAccess"]) == ("notify", "all")  # the link is no main process
    assert int(service["WatchdogSec"]) > 2 * SILENT_S  # the tracker, which knows more, comes first
    assert int(service["LimitRTPRIO"]) > LINK_PRIORITY
    assert "[Install]" not in (DEPLOY / "systemd/adatracker@.service").read_text()  # not at boot
    assert f"rtprio {service['LimitRTPRIO']}" in (DEPLOY / "limits/adatracker.conf").read_text()
    assert MEND_AWAKE_RULE in (DEPLOY / "udev/60-adatracker.rules").read_text()


@EXHAUSTIVE
@pytest.mark.slow
def test_a_trial_runs_as_its_unit_starts_it_and_stops_as_systemd_stops_it(tmp_path):
    service = section(DEPLOY / "systemd/adatracker@.service", "Service")
    robot = ("--platform", "wheeled", "--sitl", "--segmenter", "truth", "--steps", "100000")
    command = service["ExecStart"].replace("/opt/adatracker/bin/adatracker-deploy", "-m adatracker_deploy")
    argv = shlex.split(command.replace("$ADATRACKER_ARGS", shlex.join(robot)))
    with (
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager,
        (tmp_path / "journal").open("w+") as journal,
    ):
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(60)
        told = {SOCKET_VARIABLE: str(tmp_path / "notify"), PERIOD_VARIABLE: f"{service['WatchdogSec']}000000"}
        trial = subprocess.Popen(
            [sys.executable, *argv],
            cwd=tmp_path,
            env={**os.environ, **told},
            stdin=subprocess.DEVNULL,
            stdout=journal,
            stderr=journal,
            start_new_session=True,
        )
        try:
            assert manager.recv(4096).decode().splitlines() == [
                "READY=1",
                f"WATCHDOG_USEC={service['WatchdogSec']}000000",
                "WATCHDOG=1",
            ]
            assert manager.recv(4096) == b"WATCHDOG=1"
            log = following(tmp_path / "journal", trial)
            trial.send_signal(signal.SIGTERM)  # KillMode=process: the main process alone
            assert trial.wait(60) == int(service["SuccessExitStatus"]), log.read_text()
        finally:
            trial.kill()
        assert last(manager).startswith("WATCHDOG_USEC=86400000000")
    (folder,) = (tmp_path / "trials").iterdir()
    assert read_trial(folder).summary["outcome"] == "interrupted"


def following(journal, trial):
    while "following for" not in journal.read_text():
        assert trial.poll() is None, journal.read_text()
        os.sched_yield()
    return journal


def last(manager):
    manager.settimeout(0)
    said = ""
    try:
        while True:
            said = manager.recv(4096).decode()
    except BlockingIOError:
        return said


def test_the_exact_versions_have_hashes_name_no_index_and_leave_out_torch():
    text = (DEPLOY / "requirements.txt").read_text()
    assert "://" not in text
    assert "--index" not in text
    lines = [line for line in text.splitlines() if not line.startswith(("#", " "))]
    names = [line.partition("==")[0] for line in lines]
    assert len(names) == len(set(names))
    hashed = re.findall(r"^\S+==.*\\\n    --hash=sha256:[0-9a-f]{64}", text, re.MULTILINE)
    assert len(hashed) == len(lines)
    assert {"mavsdk", "eclipse-zenoh", "python-can", "onnxruntime", "mujoco"} <= set(names)
    assert "torch" not in names
    assert "onnxruntime-gpu" not in names


def test_every_extra_is_tried_alone_in_ci():
    root = DEPLOY.parent
    extras = tomllib.loads((root / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    tried = set(
        re.findall(r"\benvironment ([a-z0-9]+)$", (root / ".ci/extras").read_text().replace(";", "\n"), re.M)
    )
    assert extras.keys() - tried == {"all", "dev", "docs"}  # sets of others, and what only developers need


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--nope",), "unknown option --nope"),
        (("--prefix",), "--prefix wants a value"),
        (("--prefix", "/nowhere", "--python", "false"), "older than Python 3.11"),
    ],
)
def test_a_wrong_request_installs_nothing(arguments, words):
    done = subprocess.run([DEPLOY / "install.sh", *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert words in line
