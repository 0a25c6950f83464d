"""Whatever goes wrong with what a robot sees, it stops: nothing is driven by what was seen before.

Segmenters that stall, raise and give rubbish, cameras that freeze, change and vanish, in the real command.
"""

from __future__ import annotations

import contextlib
import json
import sys
import threading
import time
from pathlib import Path

import pytest

from adatracker_deploy.core.messages import ZERO, Frame
from adatracker_deploy.core.task import FIRST_SIGHT_S
from adatracker_deploy.perception.mjpeg_server import MjpegServer
from adatracker_deploy.policy.base import STALE_OBSERVATION_S
from adatracker_deploy.trial.reader import read_trial
from tests.tiers import EXHAUSTIVE, sampled

from .conftest import COMMAND, started
from .ground_robots import Wheeled
from .painted import COLUMNS, RATE_HZ, ROWS, painted, painted_film, red_detector

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]

TICK_S = 0.1
"""Period of the default policy."""
LIMIT_S = 0.3
"""From the onset to the last command's being zero."""
BUSY_S = 0.25
"""What two busy cores may add."""


def failing(how: str) -> list[str]:
    return [sys.executable, str(Path(__file__).with_name("failing_segmenter.py")), how]


@pytest.fixture
def dry_run(tmp_path):
    """Start a dry run with the painted person's detector."""
    detector = str(red_detector(tmp_path / "red.onnx"))
    common = "--platform", "wheeled", "--dry-run", "--steps", "600", "--json", "--segmenter", detector
    with started(tmp_path, *common, "--prompt", "person") as start:
        yield start


@pytest.fixture(scope="module")
def person(tmp_path_factory):
    """A film of somebody, long enough for anything to go wrong meanwhile."""
    return str(painted_film(tmp_path_factory.mktemp("films") / "person.avi", seconds=30))


def stopped_for_good(folder: Path, onset_ns: int, what: str, measured) -> None:
    """See by the only trial's log that nothing was driven by an old frame, and nothing after the stop."""
    (trial,) = map(read_trial, (folder / "trials").iterdir())
    assert trial.complete
    for step in trial.steps:
        if step.latency.observation_age_ms > STALE_OBSERVATION_S * 1e3:
            assert (step.box, step.action, step.command) == (None, (), ZERO)
    driven_ns = [step.t_ns for step in trial.steps if step.command != ZERO]
    assert len(driven_ns) > 5
    zero_s = (driven_ns[-1] - onset_ns) / 1e9 + TICK_S  # or sooner: the trial may have ended before that tick
    measured(f"dry or wheeled, {what}: zero within {zero_s:.2f} s")
    assert zero_s < LIMIT_S + BUSY_S


RUBBISH = "system_fault"
SEGMENTERS = {
    "stalls": ("safety_stop", "no new camera frame for 2"),
    "raises": (RUBBISH, "perception: ZeroDivisionError: the network has no weights"),
    "earlier": (RUBBISH, "segmenter: returned an observation of another frame"),
    "not a number": (RUBBISH, "segmenter: returned an invalid box"),
}


@EXHAUSTIVE
@pytest.mark.parametrize("how", ["earlier", "not a number"])
def test_a_segmenter_that_gives_rubbish_ends_a_dry_run(dry_run, person, tmp_path, measured, how):
    status, summary, err = dry_run("--camera", person, command=failing(how)).end()
    outcome, reason = SEGMENTERS[how]
    assert (status, summary["outcome"]) == (1, outcome), err
    assert reason in summary["reason"]
    assert "Traceback" not in err
    stopped_for_good(tmp_path, int((tmp_path / "onset").read_text()), f"segmenter: {how}", measured)


@EXHAUSTIVE
def test_a_network_that_begins_to_give_no_numbers_ends_a_dry_run(dry_run, tmp_path, measured):
    film = painted_film(tmp_path / "dark.avi", seconds=20, until_s=3)  # a dark picture scores 0 / 0
    status, summary, err = dry_run("--camera", str(film), command=COMMAND).end()
    assert (status, summary["outcome"]) == (1, "system_fault"), err
    assert "red.onnx: gave output0 with numbers that are not finite" in summary["reason"]
    (trial,) = map(read_trial, (tmp_path / "trials").iterdir())
    assert trial.steps[-1].frame_seq <= 3 * RATE_HZ  # the last picture with somebody in it, or one before


@EXHAUSTIVE
def test_a_segmenter_that_hangs_is_not_the_next_trials(dry_run, person, tmp_path):
    run = dry_run("--camera", person, "--trials", "2", command=failing("hangs"))
    status, _, err = run.end()
    assert status == 1
    assert "the segmenter still hangs in a frame of an earlier trial" in " ".join(err.split())
    assert "Traceback" not in err
    (folder,) = (tmp_path / "trials").iterdir()
    assert json.loads((folder / "summary.json").read_text())["outcome"] == "safety_stop"


class Eye:
    """A camera over HTTP that a test can freeze, change and take away."""

    def __init__(self) -> None:
        self.server = MjpegServer()
        self.seq = 0
        self.frozen = False
        self.size = ROWS, COLUMNS
        self._ended = threading.Event()
        self._news = threading.Condition()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        picture = painted(0)
        while not self._ended.wait(1 / RATE_HZ):
            self.seq += 1
            picture = picture if self.frozen else painted(self.seq, self.size)
            self.server.publish(Frame(picture, 0, self.seq))
            with self._news:
                self._news.notify_all()

    def wait_for(self, seq: int) -> None:
        """Return when so many pictures have been shown."""
        with self._news:
            assert self._news.wait_for(lambda: self.seq >= seq, timeout=60)

    def freeze(self) -> None:
        self.frozen = True

    def grow(self) -> None:
        self.size = 2 * ROWS, 2 * COLUMNS

    def restart(self) -> None:
        """Vanish, and be there again at the same address."""
        port = self.server.port
        self.server.close()
        self.server = MjpegServer(port)

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self.server.close()


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        pytest.param(Eye.freeze, "has given the very same picture for 1.", marks=EXHAUSTIVE),
        pytest.param(Eye.grow, "the picture's size changed from 96x64 to 192x128 px", marks=EXHAUSTIVE),
        (Eye.restart, "the stream has ended"),
    ],
)
def test_a_camera_that_goes_wrong_ends_a_dry_run_and_its_return_changes_nothing(
    dry_run, tmp_path, measured, fault, reason
):
    with contextlib.closing(Eye()) as eye:
        run = dry_run("--camera", eye.server.url, command=COMMAND)
        assert any("following" in line for line in run.process.stderr)
        eye.wait_for(eye.seq + round(1.5 * RATE_HZ))
        onset_ns = time.monotonic_ns()
        fault(eye)
        status, summary, err = run.end()
    assert (status, summary["outcome"]) == (1, "system_fault"), err
    assert reason in summary["reason"]
    assert "Traceback" not in err
    stopped_for_good(tmp_path, onset_ns, f"camera: {fault.__name__}", measured)


@EXHAUSTIVE
def test_a_robot_that_stops_while_nobody_is_seen_ends_the_search_and_says_why(tmp_path):
    with (
        contextlib.closing(Wheeled(tmp_path)) as robot,
        started(tmp_path, "--platform", "wheeled", "--profile", str(robot.profile)) as start,
    ):
        run = start("--segmenter", "truth", "--json", command=failing("nobody"))
        assert any("looking for the person" in line for line in run.process.stderr)
        cut_s = time.monotonic()
        robot.cable.cut()
        status, summary, err = run.end()
        assert time.monotonic() - cut_s < FIRST_SIGHT_S
        assert (status, summary["outcome"]) == (1, "safety_stop"), err
        assert "no person" not in summary["reason"]


@pytest.mark.parametrize("how", sampled(("stalls", "raises"), everyday=("raises",)))
def test_a_robot_whose_segmenter_goes_wrong_stands_and_begins_no_other_trial(tmp_path, measured, how):
    with (
        contextlib.closing(Wheeled(tmp_path, "--scenario", '{"seed": 3, "target_speed_m_s": 0.5}')) as robot,
        started(tmp_path, "--platform", "wheeled", "--profile", str(robot.profile)) as start,
    ):
        run = start(
            *("--segmenter", "truth", "--steps", "2000", "--trials", "2", "--json"), command=failing(how)
        )
        status, summary, err = run.end()
        outcome, reason = SEGMENTERS[how]
        (trial,) = summary["trials"]
        assert (status, trial["outcome"]) == (1, outcome), err
        assert reason in trial["reason"]
        assert "a real robot moves again only when it is told to" in " ".join(err.split())
        onset_ns = int((tmp_path / "onset").read_text())
        stopped_for_good(tmp_path, onset_ns, f"wheeled, segmenter: {how}", measured)
        moving = [sample for sample in robot.watcher.samples if sample.speed_m_s > 0.05]
        stood_s = moving[-1].t_s - onset_ns / 1e9
        measured(f"wheeled, segmenter {how}: stands after {stood_s:.2f} s")
        assert 0 < stood_s < LIMIT_S + 0.5 + BUSY_S  # and the braking
