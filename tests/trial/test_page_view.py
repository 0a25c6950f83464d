"""The operator's page of a run: it shows what is logged, brings clicks to the tracker, and stops it."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.page.address import Address, free_port
from adatracker_deploy.trial.ipc import PageStart
from adatracker_deploy.trial.page_view import of_step
from adatracker_deploy.trial.reader import read_trial
from tests.page.browsing import Browser
from tests.trial.records import REFERENCE, a_log, a_step

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]


@contextlib.contextmanager
def tracker(tmp_path, answers="answers"):
    """A tracker in a process of its own, a browser that knows its page, and its log's folder."""
    command = [sys.executable, "-m", "tests.trial.paged_tracker", str(tmp_path), answers]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        try:
            port, token, folder = process.stdout.readline().split()
            yield process, Browser(SimpleNamespace(port=int(port), token=token)), Path(folder)
        finally:
            process.kill()


def is_following(update):
    return update[0].get("state", {}).get("phase") == "following"


def test_what_is_seen_is_shown_before_the_first_tick_and_then_every_tick_with_its_picture(tmp_path):
    with tracker(tmp_path) as (process, browser, folder):
        with browser.feed() as stream:
            stream.until(lambda update: update[0].get("state", {}).get("phase") == "looking")
            news, jpeg, mask = stream.until(lambda update: is_following(update) and update[1])
        process.send_signal(signal.SIGTERM)
        assert process.stdout.read() == "stopped\n"
    state = news["state"]
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert picture.shape == (120, 160)
    assert picture.mean() == pytest.approx(state["seq"] % 256, abs=2)  # each is brighter than the last
    assert mask.startswith(b"\x89PNG")
    assert state["box"] == [REFERENCE.cx, REFERENCE.cy, REFERENCE.w, REFERENCE.h]
    trial = read_trial(folder)
    assert trial.steps[0].step == 20  # what was looked at before is not in the log
    assert len(trial.frame_seqs) == len(trial.steps)


def test_a_click_reaches_the_tracker_and_what_became_of_it_the_page(tmp_path):
    with tracker(tmp_path) as (process, browser, folder), browser.feed() as stream:
        assert browser.post("/choose", seq=21, x=0.25, y=0.75) == (202, {"number": 1})
        assert process.stdout.readline() == "1 21 0.25 0.75\n"
        news, *_ = stream.until(lambda update: "events" in update[0])
        assert news["events"] == [["warning", "click 1"]]
        process.send_signal(signal.SIGTERM)
        process.wait()
        assert [event.message for event in read_trial(folder).events] == ["click 1"]


def test_the_stop_is_the_commands_own_and_the_log_is_closed(tmp_path):
    with tracker(tmp_path) as (process, browser, folder):
        assert browser.post("/stop") == (200, {"said": "the run stops"})
        assert process.stdout.read().endswith("stopped\n")
        assert process.wait(10) == 0
    assert read_trial(folder).summary["outcome"] == "interrupted"


def test_a_tracker_that_does_not_answer_a_stop_is_killed(tmp_path):
    with tracker(tmp_path, "deaf") as (process, browser, _):
        status, answer = browser.post("/stop")
        assert status == 200
        assert "did not answer for 1 s and was killed: its link stops the robot" in answer["said"]
        assert process.wait(10) == -signal.SIGKILL


def test_a_page_whose_port_is_taken_is_refused_before_anything_moves(tmp_path):
    taken = Address(free_port(0, "the page", "--page"))
    start = PageStart(taken, {}, 0)
    with a_log(tmp_path / "one", page=start), pytest.raises(UsageError, match="for the page"):
        a_log(tmp_path / "two", page=start)


def test_a_step_is_shown_with_wish_sent_gate_and_times():
    state = of_step(a_step(3, target="tracked", driver="policy", mode="CAN"))
    assert (state["wish"]["vx"], state["sent"]["vx"], state["measured"]["vx"]) == (1.0, 0.8, 0.7)
    assert (state["gate"], state["target"], state["mode"]) == (("acceleration",), "tracked", "CAN")
    assert state["ms"]["infer"] == 2
    assert of_step(a_step(3, box=None))["target"] == "lost"
    assert [of_step(a_step(3, searching=so))["searching"] for so in (False, True)] == [False, True]
    assert of_step(a_step(3, stale=True, box=None, target="tracked"))["target"] == "stale"
    assert "sent" not in of_step(a_step(3, sent=None))
