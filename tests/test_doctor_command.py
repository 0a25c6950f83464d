"""``doctor`` through the real command: this machine, simulated robots, and one that is not there."""

from __future__ import annotations

import json
import socket

import cv2
import numpy as np
import pytest
import yaml

from adatracker_deploy.cli import main
from adatracker_deploy.doctor import machine
from adatracker_deploy.registry import profile_dir
from tests.tiers import sampled

pytestmark = pytest.mark.slow

QUICK = ("doctor", "--seconds", "1", "--segmenter", "truth")


@pytest.fixture
def doctor(tmp_path, capsys):
    def ask(*arguments):
        status = main([*QUICK, "--json", "--log-dir", str(tmp_path / "trials"), *arguments])
        out, err = capsys.readouterr()
        return status, json.loads(out) if out else None, err

    yield ask
    assert not (tmp_path / "trials").exists()


def of_part(found, part):
    return {check["name"]: check for check in found["checks"] if check["part"] == part}


@pytest.fixture
def pictures(tmp_path):
    folder = tmp_path / "pictures"
    folder.mkdir()
    for number in range(60):
        cv2.imwrite(str(folder / f"{number:02}.png"), np.full((48, 64, 3), 4 * number, np.uint8))
    return folder


def test_a_machine_alone_is_looked_at(doctor):
    status, found, err = doctor()
    assert status == (0 if found["fit"] else 1)
    assert set(of_part(found, "machine")) == {
        "cores",
        "frequency",
        "real-time priority",
        "clock",
        "disk space",
        "onnxruntime",
    }
    assert set(of_part(found, "timing")) == {"disk speed", "policy", "loop"}
    assert "fit for a trial" in err
    assert ("not fit" in err) != found["fit"]


def test_the_commands_that_mend_it_are_printed_once_and_not_run(doctor, monkeypatch):
    monkeypatch.setattr(
        machine, "runtime_distributions", lambda: {"onnxruntime": "1", "onnxruntime-gpu": "2"}
    )
    status, found, err = doctor("--fix")
    fix = of_part(found, "machine")["onnxruntime"]["fix"]
    assert (status, fix.count("\n")) == (1, 1)
    assert f"# onnxruntime\n{fix}\n" in err
    assert err.count("pip install onnxruntime-gpu") == 2  # once in the sentence


def test_the_segmenter_is_timed_unless_it_is_a_rehearsals(doctor):
    _, found, _ = doctor("--segmenter", "embedded")
    timing = of_part(found, "timing")
    assert "640x480 takes p50" in timing["perception"]["message"]
    assert timing["perception"]["message"].count(" on cpu") == 3  # a detector and two mask heads
    assert timing["policy"]["message"].startswith("on cpu a tick takes p50")


def test_a_cameras_rate_and_size_are_told(doctor, pictures):
    _, found, _ = doctor("--camera", f"{pictures}?rate=20")
    camera = of_part(found, "camera")["camera"]
    assert camera["message"].startswith("64x48 at ")
    assert 5 < float(camera["message"].split()[2]) < 21  # a busy machine misses some of the 20


def test_a_camera_that_gives_nothing_refuses(doctor):
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        status, found, err = doctor("--camera", f"http://127.0.0.1:{nobody.getsockname()[1]}/")
    camera = of_part(found, "camera")["camera"]
    assert (status, found["fit"], camera["ok"], camera["blocking"]) == (1, False, False, True)
    assert "not fit for a trial: 1 to fix" in err


@pytest.mark.parametrize("platform", sampled(("wheeled", "quadruped", "drone"), everyday=("drone",)))
def test_a_simulated_robot_is_asked_over_its_wire_and_does_not_move(doctor, platform):
    status, found, _ = doctor("--platform", platform, "--sitl")
    checks = of_part(found, platform)
    assert checks["battery"]["ok"]
    assert all(check["ok"] for check in checks.values() if check["blocking"])
    assert ("camera" in checks) == (platform != "drone")  # a drone's is drawn in the tracker
    assert status == (0 if found["fit"] else 1)


def test_a_robot_that_is_not_there_refuses_with_a_sentence(doctor, tmp_path):
    document = yaml.safe_load((profile_dir() / "scout.yaml").read_text())
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        document["connection"].update(interface="socketcand", host="127.0.0.1", port=nobody.getsockname()[1])
        document["camera"]["uri"] = "world://simple_room"
        profile = tmp_path / "here.yaml"
        profile.write_text(yaml.safe_dump(document))
        status, found, _ = doctor("--platform", "wheeled", "--profile", str(profile))
    assert status == 1
    (connection,) = of_part(found, "wheeled").values()
    assert not connection["ok"]
    assert "127.0.0.1" in connection["message"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--sitl",), "name it with --platform"),
        (("--profile", "scout"), "name it with --platform"),
        (("--platform", "tricycle"), "tricycle"),
        (("--seconds", "0"), "--seconds: 0 is out of range [1, 3600]"),
        (("--camera", "missing.mp4"), "missing.mp4"),
        (("--policy", "missing"), "missing"),
        (("--segmenter", "magic"), "segmenter 'magic'"),
        (("--provider", "gpu"), "invalid choice: 'gpu'"),
        (("--provider", "coreml"), "provider 'coreml' is not in this onnxruntime, which has cpu"),
        (("--policy", "pid", "--provider", "coreml"), "provider 'coreml' is not in this onnxruntime"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(doctor, arguments, words):
    status, found, err = doctor(*arguments)
    assert (status, found) == (2, None)
    (line,) = err.strip().splitlines()
    assert words in line
