"""A click's way without a robot: from the page over the log's writer to perception, and back in words."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from adatracker_deploy.app.trial_page import Clicks, unchoosable
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.messages import Frame
from adatracker_deploy.page.address import Address, free_port
from adatracker_deploy.perception.pipeline import Perception
from adatracker_deploy.perception.target.choice import Choice
from adatracker_deploy.perception.target_segmenter import TargetSegmenter
from adatracker_deploy.trial.ipc import PageStart
from tests.page.browsing import Browser
from tests.perception.test_target_segmenter import COLUMNS, GREEN, RED, ROWS, Colours, scene
from tests.trial.records import a_log
from tests.trial.test_log import eventually

BOTH = (RED, 50, 60, 100, 180), (GREEN, 200, 60, 250, 180)


class Painted:
    """A camera that shows both of them, at 20 Hz of the given clock."""

    def read(self, now_ns):
        return Frame(scene(*BOTH), now_ns, 1 + now_ns // 50_000_000)


@pytest.fixture
def run(tmp_path):
    """A log with a page, its browser, and perception that waits for a click."""
    address = Address(free_port(0, "the page", "--page"))
    segmenter = TargetSegmenter(Colours(masks=True), None, Choice.read("click"))
    with (
        a_log(tmp_path, page=PageStart(address, {}, 0)) as log,
        Perception(Painted(), segmenter, MonotonicClock(), 200.0) as perception,
    ):
        yield SimpleNamespace(log=log, browser=Browser(address), perception=perception, clicks=Clicks(log))


def told(run):
    """Return the next words about a click, as the loop gets them: tick by tick."""

    def words():
        seen = run.perception.newest()
        if seen is None:
            return None
        run.log.look(seen.frame, seen.observation, seen.frame.t_ns)
        run.clicks.pass_on(run.perception)
        news, warns = run.clicks.news(seen.observation)
        return (news, warns, seen) if news else None

    return eventually(words)


def test_who_is_clicked_becomes_the_target_and_who_is_nobody_does_not(run):
    eventually(run.perception.newest)
    run.browser.post("/choose", seq=0, x=150 / COLUMNS, y=120 / ROWS)
    news, warns, seen = told(run)
    assert news == "click at 0.38, 0.50: nobody was found there, so the target is the same as before"
    assert (warns, seen.observation.box) == (True, None)
    run.browser.post("/choose", seq=0, x=225 / COLUMNS, y=120 / ROWS)
    news, warns, seen = told(run)
    assert news == "click at 0.56, 0.50: the target is the person in the box 0.50, 0.25, 0.62, 0.75"
    assert (warns, seen.observation.pick.taken) == (False, 1)
    assert seen.observation.box.cx * COLUMNS == pytest.approx(225)
    assert np.any(seen.observation.mask == 1)


def test_only_a_segmenter_of_pictures_can_be_told_whom_to_follow():
    assert unchoosable(needs_truth=False) == ""
    assert "knows the target" in unchoosable(needs_truth=True)
