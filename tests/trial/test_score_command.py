"""``adatracker-deploy score``."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from adatracker_deploy.cli import main
from tests.trial.records import a_frame, a_log, a_step, a_trial, an_observation

BOXES = Path(__file__).parents[3] / "shared" / "data" / "boxes"


def score(capsys, *arguments):
    """Return (exit status, stdout, stderr)."""
    status = main(["score", *map(str, arguments)])
    return status, *capsys.readouterr()


@pytest.fixture(scope="module")
def trials(tmp_path_factory):
    """One perfect trial and one that lost its target for its second half."""
    folder = tmp_path_factory.mktemp("trials")
    a_trial(folder / "a", [a_step(step) for step in range(11)], {"outcome": "completed", "stop_s": 0.3})
    a_trial(folder / "b", [a_step(step, box=None if step > 5 else a_step(0).box) for step in range(11)])
    return folder


def test_a_trial_is_scored_again_from_its_log(capsys, trials):
    status, out, err = score(capsys, trials / "a", "--json")
    scored = json.loads(out)
    assert (status, err) == (0, "")
    assert out.count("\n") == 1
    assert (scored["mr"], scored["el"], scored["steps"], scored["outcome"]) == (1.0, 10, 10, "completed")
    assert (scored["platform"], scored["policy"], scored["stop_s"]) == ("drone", "pid", 0.3)


def test_folders_of_trials_are_searched_and_averaged(capsys, trials):
    status, out, _ = score(capsys, trials, "--json")
    scored = json.loads(out)
    assert status == 0
    assert [trial["mr"] for trial in scored["trials"]] == [1.0, 0.5]
    assert scored["mean"]["mr"] == 0.75
    assert scored["std"]["mr"] == pytest.approx(0.125**0.5)


def test_the_table_names_each_trial(capsys, trials):
    status, out, _ = score(capsys, trials)
    assert status == 0
    assert out.count("completed") == 2
    assert "0.75 ± 0.35" in out


def test_a_trial_whose_tracker_was_killed_is_a_system_fault(capsys, tmp_path):
    with a_log(tmp_path) as log:
        for step in range(4):
            log.step(a_step(step), a_frame(step), an_observation(step))
    status, out, _ = score(capsys, log.folder, "--json")
    assert status == 0
    assert (json.loads(out)["outcome"], json.loads(out)["el"]) == ("system_fault", 3)


def test_good_trials_are_scored_when_one_is_bad(capsys, trials, tmp_path):
    (tmp_path / "trial.mcap").write_text("nonsense")
    status, out, err = score(capsys, trials / "a", tmp_path, tmp_path / "nothing", "--json")
    assert status == 0
    assert json.loads(out)["mr"] == 1.0
    assert [line.startswith("adatracker-deploy: left out: ") for line in err.splitlines()] == [True, True]


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ([], "say what to score"),
        (["nowhere"], "no such file or folder"),
        (["."], "no trials in it"),
        (["nowhere", "neither"], "none of these could be scored"),
        (["--boxes", "boxes.txt"], "needs --image-size"),
        (["--boxes", "boxes.txt", "--image-size", "big"], "expected WIDTHxHEIGHT"),
        (["--boxes", "nowhere", "--image-size", "640x480"], "No such file"),
        (["--boxes", "boxes.txt", "--image-size", "640x480", "trial"], "say what to score"),
        (["--image-size", "640x480", "trial"], "belong to --boxes"),
        (["--boxes", "words.txt", "--image-size", "640x480"], "words.txt: line 2: expected x,y,w,h"),
        (["--boxes", "empty.txt", "--image-size", "640x480"], "is empty"),
        (["--boxes", "boxes.txt", "--absent", "words.txt", "--image-size", "640x480"], "expected 2 flags"),
    ],
)
def test_a_wrong_request_exits_with_2_and_says_why(capsys, tmp_path, monkeypatch, arguments, reason):
    monkeypatch.chdir(tmp_path)
    Path("boxes.txt").write_text("1,2,3,4\n1,2,3,4\n")
    Path("words.txt").write_text("1,2,3,4\nfour\n")
    Path("empty.txt").write_text("\n")
    status, out, err = score(capsys, *arguments)
    assert (status, out) == (2, "")
    assert reason in err.splitlines()[-1]


def test_boxes_are_scored_with_lost_ones_as_zero(capsys, tmp_path):
    file = tmp_path / "boxes.txt"
    file.write_text("40,30,20,20\n40 30 20 20\nnan,nan,nan,nan\n0\t0\t0\t0\n70,70,20,20\n")
    _, out, _ = score(capsys, "--boxes", file, "--image-size", "100x100", "--json")
    scored = json.loads(out)
    assert scored["mr"] == pytest.approx((1 + 0 + 0 + 1 / 1.5) / 4)  # the last is 0.3, 0.4 from the first
    assert (scored["el"], scored["visibility"], scored["outcome"]) == (4, 0.5, "completed")


@pytest.mark.skipif(not BOXES.is_dir(), reason="needs ../shared/data/boxes, which is not part of the project")
@pytest.mark.parametrize("person", range(1, 6))
def test_recorded_people_score_as_ten_independent_lines_say(capsys, person):
    boxes, absent = BOXES / f"person-{person}.txt", BOXES / f"person-{person}.absent.txt"
    _, out, _ = score(capsys, "--boxes", boxes, "--absent", absent, "--image-size", "1280x720", "--json")

    x, y, w, h = (np.loadtxt(boxes, delimiter=",") / [1280, 720, 1280, 720]).T
    seen = (np.loadtxt(absent, delimiter=",").ravel() == 0) & (w > 0) & (h > 0)
    runs = np.convolve(~seen, np.ones(50))[: len(seen)] == 50
    end = int(runs.argmax()) + 1 if runs.any() else len(seen)
    centre = np.hypot(x + w / 2 - (x + w / 2)[0], y + h / 2 - (y + h / 2)[0])
    r = np.where(seen, 1 / (1 + centre + np.hypot(w - w[0], h - h[0])), 0)[1:end]

    scored = json.loads(out)
    assert seen[0]
    assert scored["mr"] == pytest.approx(r.mean(), abs=1e-12)
    assert scored["mr_visible"] == pytest.approx(r[seen[1:end]].mean(), abs=1e-12)
    assert scored["visibility"] == pytest.approx(seen[1:end].mean())
    assert scored["el"] == end - 1
