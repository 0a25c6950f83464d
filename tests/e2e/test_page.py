"""A rehearsal from its page: a click starts it, another chooses somebody else, and STOP ends it."""

from __future__ import annotations

import re
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from adatracker_deploy.trial.reader import read_trial
from tests.page.browsing import Browser

from .conftest import started

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]
RUN = (
    *("--platform", "wheeled", "--sitl", "--others", "3", "--steps", "2000", "--target", "click"),
    *("--policy", "pid", "--page", "0", "--json"),
)


@pytest.fixture
def paged(tmp_path):
    """A rehearsal that waits for a click, and a browser at its page."""
    with started(tmp_path) as start:
        run = start(*RUN)
        said = []
        for line in run.process.stderr:
            said.append(line)
            if found := re.match(r"page: http://127\.0\.0\.1:(\d+)/#(\S+)", line):
                break
        else:
            pytest.fail(f"the run never said where its page is:\n{''.join(said)}")
        yield Browser(SimpleNamespace(port=int(found[1]), token=found[2])), run


def people(mask_png):
    """Return the centres of people's pieces in a mask, in fractions of the picture, the largest first."""
    bgr = cv2.imdecode(np.frombuffer(mask_png, np.uint8), cv2.IMREAD_COLOR)
    orange = (bgr[..., 2] > 200) & (bgr[..., 1] > 120) & (bgr[..., 1] < 180)
    count, _, pieces, centres = cv2.connectedComponentsWithStats(orange.astype(np.uint8))
    order = sorted(range(1, count), key=lambda piece: -pieces[piece, cv2.CC_STAT_AREA])
    height, width = orange.shape
    return [(centres[piece][0] / width, centres[piece][1] / height) for piece in order]


def until_it_says(stream, wanted):
    """Return the first event that fits."""

    def fits(update):
        return [text for _, text in update[0].get("events", ()) if re.search(wanted, text)]

    return fits(stream.until(fits))[0]


def choose(browser, stream, phase):
    """Click on somebody who is not the target, until somebody was found there; return what was said."""
    while True:
        news, _, mask = stream.until(
            lambda update: (
                update[0].get("state", {}).get("phase") == phase and update[2] and people(update[2])
            )
        )
        x, y = people(mask)[0]
        assert browser.post("/choose", seq=news["state"]["seq"], x=x, y=y)[0] == 202
        said = until_it_says(stream, "^click at")
        if "the target is the person in the box" in said:
            return said


def test_a_rehearsal_is_begun_redirected_and_stopped_from_its_page(paged, tmp_path, measured):
    browser, run = paged
    try:
        with browser.feed() as stream:
            choose(browser, stream, "looking")  # nothing has moved before it
            stream.until(lambda update: update[0].get("state", {}).get("step", 0) > 20)
            assert browser.post("/choose", seq=0, x=0.999, y=0.001)[0] == 202
            assert "nobody was found there" in until_it_says(stream, "^click at")
            choose(browser, stream, "following")
            status, answer = browser.post("/stop")
    except EOFError:
        pytest.fail(f"the run ended by itself: {run.end()}")
    assert (status, answer["said"]) == (200, "the run stops")
    status, summary, err = run.end()
    assert status == 130, err
    (folder,) = (tmp_path / "trials").iterdir()
    trial = read_trial(folder)
    assert trial.summary["ended"]["outcome"] == "interrupted"
    picks = [step.picks for step in trial.steps]
    assert (picks[0], picks[-1]) == (1, 2)
    assert (summary["outcome"], summary["chosen_again"]) == ("takeover", 1)
    chosen_at = picks.index(2)
    assert summary["el"] == trial.steps[chosen_at - 1].step
    for step in trial.steps:
        if step.target == "choosing":
            assert (step.command.vx, step.command.yaw_rate, step.action) == (0, 0, ())
    told = [event.message for event in trial.events if event.message.startswith("click at")]
    assert sum("the target is the person in the box" in text for text in told) == 2
    measured(f"page: chosen again at step {chosen_at}, stopped at {trial.steps[-1].step}")
