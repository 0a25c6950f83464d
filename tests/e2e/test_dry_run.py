"""Real films through the real command, and frame by frame through the segmenter: no person is mixed up."""

from __future__ import annotations

import functools
import itertools
import json
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.core.messages import Frame, TargetState
from adatracker_deploy.perception.capture import Capture
from adatracker_deploy.perception.pipeline import perceive
from adatracker_deploy.perception.segmenters import EMBEDDED, open_segmenter
from adatracker_deploy.perception.target.choice import Choice
from adatracker_deploy.perception.target.recognition import BRIDGED_S
from tests.tiers import EXHAUSTIVE

from .conftest import started

VIDEO = Path(__file__).parents[3] / "shared" / "data" / "video"
pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]
needs_video = pytest.mark.skipif(
    not VIDEO.is_dir(), reason="needs ../shared/data/video, which is not part of the project"
)
DRY = ("--platform", "wheeled", "--dry-run")


@pytest.fixture
def dry_run(tmp_path):
    """Give a function that runs the command to its end: exit status, JSON summary, stderr, seconds."""
    with started(tmp_path, *DRY, "--json") as start:

        def run(camera, *more):
            began_s = time.monotonic()
            return *start("--camera", str(camera), *more).end(timeout_s=120), time.monotonic() - began_s

        yield run


@EXHAUSTIVE
@needs_video
def test_a_film_is_followed_to_its_end_and_scored_and_nothing_moves(dry_run, tmp_path, capsys, measured):
    status, summary, err, _ = dry_run(VIDEO / "bedroom.mp4", "--steps", "2000")
    assert status == 0, err
    assert summary["outcome"] == "completed"
    assert "the video has ended" in summary["reason"]
    assert summary["el"] > 20
    (folder,) = (tmp_path / "trials").iterdir()
    assert "dry" in folder.name
    assert "engaged" in err
    assert main(["score", str(folder), "--json"]) == 0
    scored = json.loads(capsys.readouterr().out)
    assert (scored["mr"], scored["steps"]) == (summary["mr"], summary["steps"])
    assert json.loads((folder / "summary.json").read_text())["mr"] == summary["mr"]
    latency = summary["latency_ms"]["p50"]
    measured(f"bedroom.mp4, embedded: MR {summary['mr']:.2f}, EL {summary['el']}, p50 {latency:.0f} ms")


@needs_video
def test_so_many_steps_and_no_more(dry_run):
    status, summary, err, _ = dry_run(VIDEO / "bedroom.mp4", "--steps", "15")
    assert (status, summary["outcome"], summary["steps"]) == (0, "completed", 15), err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--sitl",), "--dry-run moves nothing, --sitl moves a simulated robot: give one of them"),
        (("--prompt", "person, unicorn"), "does not know the word 'unicorn'; it knows person, bicycle, car"),
        (("--prompt", "chair"), "expected words with 'person' among them"),
        (("--target", "tallest"), "target 'tallest': expected ahead, largest, central, best, click, #N"),
        (("--segmenter", "magic"), "segmenter 'magic': expected embedded, a model's .onnx"),
        (("--segmenter", "truth"), "--segmenter truth needs a virtual world"),
        (("--segmenter", "missing.onnx"), "missing.onnx"),
        (("--camera", "missing.mp4"), "missing.mp4"),
    ],
)
def test_what_is_wrong_is_said_in_one_line_before_anything_starts(capsys, tmp_path, arguments, words):
    film = nobody(tmp_path / "film.avi", seconds=0.2)
    logs = tmp_path / "trials"
    assert main([*DRY, "--camera", str(film), "--log-dir", str(logs), *arguments]) == 2
    out, err = capsys.readouterr()
    (line,) = err.strip().splitlines()
    assert words in line
    assert out == ""
    assert not logs.exists()


def nobody(path, seconds, rate_hz=10):
    """Write a film of a wall with a window that moves up and down; return its path."""
    writer = cv2.VideoWriter(
        str(path), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter_fourcc(*"MJPG"), rate_hz, (320, 240)
    )
    for number in range(round(seconds * rate_hz)):
        picture = np.full((240, 320, 3), 150, np.uint8)
        picture[40 + number % 20 : 90 + number % 20, 200:280] = (230, 200, 120)
        writer.write(picture)
    writer.release()
    return path


@EXHAUSTIVE
@pytest.mark.parametrize(
    ("seconds", "reason"),
    [(40, "no person was seen within 10 s"), (2, "no person was seen before the end: camera")],
)
def test_a_film_without_anybody_fails_with_a_sentence(dry_run, tmp_path, seconds, reason):
    """The run waits ten seconds for a person to appear, or until the film is over."""
    status, summary, err, took_s = dry_run(nobody(tmp_path / "wall.avi", seconds))
    assert status == 1
    assert summary["outcome"] == "system_fault"
    assert reason in summary["reason"]
    assert reason in " ".join(err.split())
    assert "Traceback" not in err
    assert took_s < 25


@functools.cache  # for the process: half a minute
def watched(name):
    """Return the embedded segmenter's observation of each frame of a film, checked by `perceive`."""
    segmenter, _ = open_segmenter(EMBEDDED, "person, obstacles", Choice())
    capture = Capture(str(VIDEO / name))
    period_ns = round(1e9 / capture.rate_hz)
    seen = []
    for number in itertools.count(1):
        if not capture.grab():
            break
        frame = Frame(capture.rgb(), 1_000_000_000 + number * period_ns, number)
        seen.append(perceive(frame, segmenter).observation)
    capture.close()
    return seen


FILMS = ("03_skateboarder.mp4", "05_default_juggle.mp4", "bedroom.mp4")
SEEN = {TargetState.TRACKED, TargetState.REACQUIRED}


@pytest.fixture
def films():
    return {name: watched(name) for name in FILMS}


@EXHAUSTIVE
@needs_video
def test_in_two_of_three_films_with_a_moving_camera_the_person_is_kept_to_the_end(films, measured):
    kept = []
    for name, seen in films.items():
        since = next(place for place, each in enumerate(seen) if each.target)
        states = [each.target for each in seen[since:]]
        share = sum(state in SEEN for state in states) / len(states)
        kept.append(states[-1] in SEEN)
        measured(f"{name}: in sight in {share:.2f} of {len(states)} frames, {states[-1].value} in the last")
    assert sum(kept) >= 2


@EXHAUSTIVE
@needs_video
@pytest.mark.parametrize("name", FILMS)
def test_from_one_frame_to_the_next_the_box_is_never_somebody_elses(films, name):
    """Boxes of two frames in a row overlap by a third, or the target was out of sight between them."""
    for before, after in itertools.pairwise(films[name]):
        if before.box and after.box:
            assert after.target in (TargetState.TRACKED, TargetState.COASTING)
            assert before.box.iou(after.box) > 1 / 3, f"frames {before.seq} and {after.seq}"


@EXHAUSTIVE
@needs_video
@pytest.mark.parametrize("name", FILMS)
def test_states_boxes_and_masks_say_the_same(films, name):
    seen_ns = None
    for each in films[name]:
        seen_ns = each.t_ns if each.target in SEEN else seen_ns
        if each.target in SEEN:
            assert each.box is not None
        elif each.box is not None:  # where it is expected, for a moment
            assert each.target is TargetState.COASTING
            assert each.t_ns - seen_ns <= BRIDGED_S * 1e9 + 1
        assert (each.box is not None) or not (each.mask == 1).any()
    for before, after in itertools.pairwise(films[name]):
        if after.target is TargetState.REACQUIRED:
            assert before.target is TargetState.LOST
        if before.target is TargetState.LOST:
            assert after.target in (TargetState.LOST, TargetState.REACQUIRED)
