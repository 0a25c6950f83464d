"""A rehearsal is watched while it runs, by a viewer that shares no code with the toolkit."""

from __future__ import annotations

import itertools
import json
import re
import time

import cv2
import numpy as np
import pytest

from tests.tiers import EXHAUSTIVE

from .conftest import started

pytest.importorskip("websockets", reason="needs the extra 'live'")

from adatracker_deploy.perception.drawing import MASK_SIZE
from adatracker_deploy.trial.reader import read_trial
from tests.trial.viewer import Viewer

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]
STEPS = 100


def is_step(told):
    return told.topic == "/step"


@pytest.fixture
def watched(tmp_path):
    """The command's line that says where it can be watched, a viewer there, and the run."""
    arguments = (
        "--platform",
        "wheeled",
        "--sitl",
        "--segmenter",
        "truth",
        "--policy",
        "pid",
        "--steps",
        str(STEPS),
        "--live",
        "0",
        "--json",
    )
    with started(tmp_path) as start:
        run = start(*arguments)
        said = []
        for line in run.process.stderr:
            said.append(line)
            if line.startswith("live view: "):
                break
        else:
            pytest.fail(f"the run never said where it can be watched:\n{''.join(said)}")
        with Viewer(int(re.search(r"ws://127\.0\.0\.1:(\d+),", line)[1])) as viewer:
            yield line, viewer, run


@EXHAUSTIVE
def test_a_viewer_sees_pictures_and_steps_at_the_loops_rate(watched, tmp_path, measured):
    line, viewer, run = watched
    assert "https://app.foxglove.dev/?ds=foxglove-websocket&ds.url=ws%3A%2F%2F127.0.0.1%3A" in line
    viewer.until(is_step)  # the run waits for no viewer: some of it may be over
    told, came_s = [], []
    while not told or not (is_step(told[-1]) and told[-1].says["step"] == STEPS):
        told.append(viewer.next(timeout_s=60))
        if is_step(told[-1]):
            came_s.append(time.monotonic())
    status, summary, err = run.end()
    assert status == 0, err
    assert summary["outcome"] == "completed"
    steps = [each.says for each in told if is_step(each)]
    first = steps[0]["step"]
    assert first <= STEPS - 20  # enough to tell a rate
    assert [step["step"] for step in steps] == list(range(first, STEPS + 1))
    (folder,) = (tmp_path / "trials").iterdir()
    assert json.loads((folder / "summary.json").read_text())["steps"] == STEPS

    by_topic = {topic: [each for each in told if each.topic == topic] for topic in {e.topic for e in told}}
    camera, masks = by_topic["/camera"], by_topic["/mask"]
    logged = read_trial(folder).steps
    seen_before = {step.frame_seq for step in logged[:first]}
    assert len(camera) == len(masks) == len({step["frame_seq"] for step in steps} - seen_before)  # each once
    for each in (camera[0], camera[-1]):
        picture = cv2.imdecode(np.frombuffer(each.says.data, np.uint8), cv2.IMREAD_COLOR)
        assert picture.std() > 5  # it shows something
    mask = cv2.imdecode(np.frombuffer(masks[-1].says.data, np.uint8), cv2.IMREAD_COLOR)
    assert mask.shape == (MASK_SIZE * 3 // 4, MASK_SIZE, 3)
    assert len(by_topic["/box"][-1].says.points) == 1
    assert len(steps[-1]["action"]) == 2
    assert steps[-2]["sent"]["vx"] != 0  # of the last the link had not said yet what it did
    assert {"velocity", "latency", "mode", "state_age_s"} <= steps[-1].keys()

    rate_hz = (STEPS - first) / (came_s[-1] - came_s[0])
    assert rate_hz == pytest.approx(summary["rate_hz"], rel=0.2)
    gap_ms = max(b - a for a, b in itertools.pairwise(came_s)) * 1e3
    measured(
        f"live view: {rate_hz:.2f} Hz, the loop {summary['rate_hz']:.2f} Hz; longest gap {gap_ms:.0f} ms"
    )
