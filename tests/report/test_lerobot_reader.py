"""lerobot's own reader, in a separate environment, finds the log's frames and actions in an export."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.core.mask_png import PALETTE
from adatracker_deploy.core.messages import ZERO, Frame, Twist
from adatracker_deploy.trial.reader import find_trials, read_trial
from tests.trial.records import START_NS, TICK_NS, a_log, a_step, an_observation

pytest.importorskip("pyarrow", reason="needs the extra 'lerobot'")

PYTHON = "ADATRACKER_LEROBOT_PYTHON"
HOW = (
    f"LEROBOT'S READER WAS NOT ASKED: set {PYTHON} to the python of an environment with lerobot and its "
    "extra 'dataset', which pins another torch (CONTRIBUTING.md)"
)


@pytest.fixture
def read(tmp_path):
    """Give a function that returns what lerobot reads from a folder."""
    python = os.environ.get(PYTHON)
    if not python:
        pytest.skip(HOW)

    def reading(folder):
        script = Path(__file__).with_name("read_lerobot.py")
        alone = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        offline = {"HF_HUB_OFFLINE": "1", "HF_HOME": str(tmp_path / "cache")}
        out = tmp_path / "read.npz"
        done = subprocess.run(
            [python, str(script), str(folder), str(out)],
            env=alone | offline,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr[-2000:]
        return np.load(out)

    return reading


def a_view(number):
    """Return a picture with a square whose place depends on the number, so that no two are alike."""
    rgb = np.full((96, 128, 3), 90, np.uint8)
    cv2.rectangle(rgb, (8 * number + 4, 20), (8 * number + 28, 70), (220, 60 + 10 * number, 40), -1)
    return Frame(rgb, START_NS + number * TICK_NS, number)


@pytest.fixture
def trial(tmp_path):
    """Log a trial of ten ticks with a gap in the middle, and after it a command that a newer one replaced."""
    with a_log(tmp_path / "trials", steps=9) as log:
        for number in range(10):
            sent = None if number == 7 else Twist(vx=0.1 * number, yaw_rate=-0.05 * number)
            log.step(
                a_step(number, sent=sent, stale=number == 5), a_view(number), an_observation(number, 64, 48)
            )
        log.close({"outcome": "lost"})
    assert not log.trouble
    return log.folder


def went_out(steps, number):
    """Return the twist that the link sent in a tick; if the tick's was never sent, the last one before it."""
    *_, last = ZERO, *(step.sent for step in steps if step.step <= number and step.sent is not None)
    return [last.vx, last.vy, last.vz, last.yaw_rate]


def is_the_logs(found, logged):
    """Check that every row lerobot read is its tick of the log."""
    steps = {step.step: step for step in logged.steps}
    frames = {frame.seq: frame for frame in logged.frames()}
    ticks = [steps[tick] for tick in found["trial.tick"].tolist()]
    sent = [went_out(logged.steps, tick.step) for tick in ticks]
    assert np.array_equal(found["action"], np.array(sent, np.float32))
    assert found["statistics/action/mean"] == pytest.approx(np.mean(sent, axis=0))
    boxes = [
        (tick.box.cx, tick.box.cy, tick.box.w, tick.box.h, 1.0) if tick.box else (0.0,) * 5 for tick in ticks
    ]
    assert np.array_equal(found["observation.target"], np.array(boxes, np.float32))
    palette = np.array(PALETTE, np.uint8)
    masks = np.rint(found["observation.images.mask"].transpose(0, 2, 3, 1) * 255).astype(np.uint8)
    for mask, shown, tick in zip(masks, found["observation.images.camera"], ticks, strict=True):
        assert np.array_equal(mask, palette[frames[tick.frame_seq].mask])
        apart = np.abs(shown.transpose(1, 2, 0) * 255 - frames[tick.frame_seq].rgb).mean()
        assert apart < 4
        for before in (tick.frame_seq - 1, tick.frame_seq + 1):  # neighbours: a slip of one would show
            if before in frames:
                other = np.abs(shown.transpose(1, 2, 0) * 255 - frames[before].rgb).mean()
                assert apart <= other


def test_frames_masks_and_actions_are_the_logs(read, trial, tmp_path):
    assert main(["export", str(trial), "--lerobot", str(tmp_path / "set")]) == 0
    found = read(tmp_path / "set")
    assert found["trial.tick"].tolist() == [0, 1, 2, 3, 6, 7, 8]
    assert found["starts"].tolist() == [0, 4]
    assert found["next.done"].tolist() == [False] * 6 + [True]
    assert set(found["task"].tolist()) == {"Follow the person."}
    assert found["rate_hz"] == 20
    is_the_logs(found, read_trial(trial))


@pytest.mark.slow
def test_a_rehearsals_export_is_its_log(read, tmp_path):
    pytest.importorskip("mujoco", reason="needs the extra 'sitl'")
    command = [sys.executable, "-m", "adatracker_deploy", "--platform", "wheeled", "--sitl", "--steps", "15"]
    eyes = ["--policy", "pid", "--segmenter", "truth", "--log-dir", str(tmp_path / "trials")]
    subprocess.run([*command, *eyes], check=True, capture_output=True, timeout=120)
    assert main(["export", str(tmp_path / "trials"), "--lerobot", str(tmp_path / "set")]) == 0
    (trial,) = find_trials(tmp_path / "trials")
    is_the_logs(read(tmp_path / "set"), read_trial(trial))
