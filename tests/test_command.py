"""Wrong requests get one clear line and exit status 2 before anything moves."""

from __future__ import annotations

import errno
import json
import os
import socket
import subprocess
import sys
from importlib.util import find_spec

import pytest
import yaml

from adatracker_deploy.cli import main
from adatracker_deploy.registry import profile_dir

DRONE = ("--platform", "drone", "--sitl")


def refused(capsys, *arguments: str) -> str:
    """Run the command, see that it was refused in one line, and return the line."""
    assert main(list(arguments)) == 2
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.strip().splitlines()
    return line


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "--platform"),
        (("--platform", "submarine", "--sitl"), "unknown platform 'submarine': installed are"),
        (("--platform", "drone,submarine", "--sitl"), "unknown platform 'submarine'"),
        (("--platform", "drone,wheeled"), "several platforms are rehearsed"),
        ((*DRONE, "--profile", "px5"), "unknown profile 'px5': known are"),
        ((*DRONE, "--profile", "no/such.yaml"), "no such file"),
        ((*DRONE, "--policy", "genius"), "unknown policy 'genius'"),
        ((*DRONE, "--policy", "no/such/folder"), "no/such/folder"),
        ((*DRONE, "--scene", "moon"), "unknown scene 'moon'"),
        ((*DRONE, "--camera", "world://moon"), "unknown scene 'moon'"),
        ((*DRONE, "--camera", "webcam"), "webcam"),
        (("--platform", "drone", "--camera", "robot://image", "--scene", "moon"), "--scene needs a virtual"),
        ((*DRONE, "--scene", "simple_room", "--camera", "world://simple_room"), "give one of them"),
        (("--platform", "drone", "--camera", "robot://image", "--others", "2"), "--others needs a"),
        (("--platform", "drone", "--camera", "robot://image", "--person", "me.glb"), "--person needs a"),
        ((*DRONE, "--others", "21"), "out of range"),
        (("--platform", "drone", "--camera", "robot://image", "--effects", "sit"), "--effects needs a"),
        ((*DRONE, "--effects", "snow"), "'snow' is none of fog"),
        ((*DRONE, "--effects", "fog=1"), "optical range of 5"),
        ((*DRONE, "--effects", "road=C"), "a body that flies has no road"),
        ((*DRONE, "--person", "no/such.glb"), "no/such.glb"),
        ((*DRONE, "--person", "pyproject.toml"), "pyproject.toml"),
        ((*DRONE, "--steps", "0"), "out of range"),
        ((*DRONE, "--steps", "ten"), "ten"),
        ((*DRONE, "--speed", "nan"), "out of range"),
        ((*DRONE, "--speed", "0.5"), "out of range"),  # a robot slower than its own time-outs looks dead
        (("--platform", "drone", "--speed", "5"), "--speed is for rehearsals"),
        ((*DRONE, "--cpu", "0-9999"), "--cpu 0-9999: core"),
        ((*DRONE, "--cpu", "fast"), "'fast' is neither a core nor a range"),
        ((*DRONE, "--stpes", "5"), "--stpes"),
        ((*DRONE, "--blur", "--no-frames"), "not allowed with"),
        ((*DRONE, "--target", "click"), "waits for a click on the page: add --page"),
        ((*DRONE, "--target", "click", "--page", "--segmenter", "truth"), "drop --target click"),
        ((*DRONE, "--page", "8800", "--live", "8800"), "cannot share a port"),
        ((*DRONE, "--page", "70000"), "out of range"),
        ((*DRONE, "--policy", "teleop"), "say with what, by --teleop DEVICE"),
        ((*DRONE, "--teleop", "no/such.jsonl"), "no/such.jsonl: cannot be read"),
        ((*DRONE, "--teleop", "pyproject.toml"), "pyproject.toml: line 1"),
        pytest.param(
            (*DRONE, "--teleop", "/dev/input/event999999"),
            "event999999: cannot be read",
            marks=pytest.mark.skipif(find_spec("evdev") is None, reason="the extra teleop is not installed"),
        ),
        ((*DRONE, "--teleop", "keyboard"), "needs a terminal in the foreground"),
        ((*DRONE, "--speed", "3", "--teleop", "keyboard"), "drop --speed"),
        (("--platform", "drone", "--fault", "link_drop@5"), "--fault is for rehearsals"),
        (("--platform", "drone", "--dry-run", "--fault", "link_drop@5"), "--fault is for rehearsals"),
        (
            (*DRONE, "--fault", "camera_gone@5"),
            "unknown for this rehearsal; known are action_jump, battery_low",
        ),
        ((*DRONE, "--fault", "link_drop"), "expected NAME@SECONDS"),
        ((*DRONE, "--fault", "link_drop@5", "--speed", "2"), "drop --speed"),
        ((*DRONE, "--fault", "camera_freeze@5", "--camera", "world://snow_village"), "drop --camera"),
        (("faults", "--fault", "earthquake"), "unknown to the matrix; known are action_jump"),
        (("faults", "--platform", "submarine"), "unknown platform 'submarine'"),
        (("faults", "--markdown", "no/such.md"), "--markdown no/such.md: cannot be read"),
        (("fly",), "fly"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(capsys, arguments, words):
    assert words in refused(capsys, *arguments)


def test_real_time_priority_that_the_system_refuses_is_refused(capsys, monkeypatch):
    def refuse(*_):
        raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    assert "--realtime: the system refuses it" in refused(capsys, *DRONE, "--realtime")


def drone_profile(tmp_path, **connection):
    document = yaml.safe_load((profile_dir() / "px4_quad.yaml").read_text())
    document["connection"].update(connection)
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(document))
    return str(path)


def test_a_real_robot_that_would_follow_a_drawn_person_is_warned_of_and_a_busy_port_named(capsys, tmp_path):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        profile = drone_profile(tmp_path, url=f"udpin://127.0.0.1:{port}")
        asked = ("--platform", "drone", "--profile", profile, "--log-dir", str(tmp_path / "trials"))
        assert main(list(asked)) == 2
    printed = capsys.readouterr()
    said = " ".join((printed.out + printed.err).split())
    assert f"UDP 127.0.0.1:{port} cannot be used" in said
    assert "warning: A REAL ROBOT WILL FOLLOW A VIRTUAL PERSON" in said
    assert not (tmp_path / "trials").exists()


def test_a_log_folder_that_cannot_be_written_is_named(capsys, tmp_path):
    (tmp_path / "file").write_text("")
    assert str(tmp_path / "file") in refused(capsys, *DRONE, "--log-dir", str(tmp_path / "file" / "trials"))


@pytest.mark.parametrize(
    ("listing", "name"),
    [("platforms", "drone"), ("profiles", "px4_quad"), ("policies", "pid"), ("scenes", "simple_room")],
)
def test_the_listings_name_what_there_is(capsys, listing, name):
    assert main([listing, "--json"]) == 0
    assert name in json.loads(capsys.readouterr().out)[listing]
    assert main([listing]) == 0
    assert name in capsys.readouterr().out


def test_a_stop_from_another_terminal_waits_for_no_library():
    code = (
        "import contextlib, json, sys\n"
        "from adatracker_deploy.cli import main\n"
        "with contextlib.suppress(SystemExit), contextlib.redirect_stdout(None):\n"
        "    main(['stop', '--help'])\n"
        "print(json.dumps(list(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    loaded = set(json.loads(done.stdout))
    assert "adatracker_deploy.cli.stop" in loaded
    assert not loaded & {"numpy", "onnxruntime", "cv2", "rich", "adatracker_deploy.registry"}
