"""``adatracker-deploy score``."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from adatracker_deploy.cli import main
from tests.trial.records import a_frame, a_log, a_step, a_trial, an_observation

BOXES = Path(__file__).parents[3] / "shared" / "data" / "boxes"

R1, MOVED, LOST = "40,30,20,20", "70,70,20,20", "0,0,0,0"
"""In 100 x 100 pixels: the reference, one that is 0.3 and 0.4 off it (R = 2/3), and none."""


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


def test_a_trial_that_is_named_several_times_is_scored_once(capsys, trials, tmp_path, monkeypatch):
    (tmp_path / "link").symlink_to(trials / "a")
    monkeypatch.chdir(trials)
    (file,) = (trials / "b").rglob("trial.mcap")
    named = trials, "a", file, tmp_path / "link"
    _, out, err = score(capsys, *named, "--json")
    assert ([trial["mr"] for trial in json.loads(out)["trials"]], err) == ([1.0, 0.5], "")


def test_the_table_names_each_trial(capsys, trials):
    status, out, _ = score(capsys, trials)
    assert status == 0
    assert "2 completed; 2 of 2 at the horizon" in out
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
        ([], "name what to score"),
        (["nowhere"], "no such file or folder"),
        (["hollow"], "no trials in it"),
        (["nowhere", "neither"], "none of these could be scored"),
        (["--boxes", "boxes.txt", "--image-size", "big"], "expected WIDTHxHEIGHT"),
        (["--boxes", "nowhere", "--image-size", "640x480"], "No such file"),
        (["--boxes", "boxes.txt", "--image-size", "640x480", "trial"], "name what to score"),
        (["--boxes", "words.txt", "--image-size", "640x480"], "words.txt: line 2: expected the 4 numbers"),
        (["boxes.txt", "words.txt", "--absent", "words.txt"], "--absent is for one file"),
        (["boxes.txt", "--image-size", "9x9", "--lost-steps", "0"], "a whole number of at least 1"),
        (["boxes.txt", "--image-size", "9x9", "--least-reward", "nan"], "expected a number"),
        (["boxes.txt", "--image-size", "9x9", "--rate", "0"], "a number above 0"),
        (["boxes.txt", "--image-size", "9x9", "--drop-short", "5"], "none of these could be scored"),
        (["boxes.txt", "--image-size", "9x9", "--csv", "nowhere/file.csv"], "cannot be written"),
        (["--boxes", "empty.txt", "--image-size", "640x480"], "is empty"),
        (["--boxes", "boxes.txt", "--absent", "words.txt", "--image-size", "640x480"], "expected 2 flags"),
    ],
)
def test_a_wrong_request_exits_with_2_and_says_why(capsys, tmp_path, monkeypatch, arguments, reason):
    monkeypatch.chdir(tmp_path)
    Path("boxes.txt").write_text("1,2,3,4\n1,2,3,4\n")
    Path("words.txt").write_text("1,2,3,4\nfour\n")
    Path("empty.txt").write_text("\n")
    Path("hollow").mkdir()
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


PENCIL = {
    "a.txt": [R1] + [R1, MOVED] * 3 + [LOST] * 5,
    "b.txt": [R1, MOVED, LOST, LOST, LOST, MOVED, R1, R1],
}
"""Trials whose R is 1, 2/3 or 0 at every step: 11 and 7 steps long."""


@pytest.fixture
def pencil(tmp_path):
    for name, lines in PENCIL.items():
        (tmp_path / name).write_text("\n".join(lines))
    return tmp_path


@pytest.mark.parametrize(
    ("options", "scores"),
    [
        ([], ([(3 + 3 * 2 / 3) / 11, (2 + 2 * 2 / 3) / 7], [11, 7], ["completed", "completed"])),
        (["--lost-steps", "6"], ([5 / 11, (10 / 3) / 7], [11, 7], ["completed", "completed"])),
        (["--lost-steps", "5"], ([5 / 11, (10 / 3) / 7], [11, 7], ["lost", "completed"])),
        (["--lost-steps", "3"], ([5 / 9, (2 / 3) / 4], [9, 4], ["lost", "lost"])),
        (["--count-reference"], ([6 / 11, (13 / 3) / 7], [11, 7], ["completed", "completed"])),
        (["--count-reference", "--lost-steps", "3"], ([6 / 9, (5 / 3) / 4], [9, 4], ["lost", "lost"])),
        (["--drop-short", "7"], ([5 / 11], [11], ["completed"])),
        (["--drop-short", "6"], ([5 / 11, (10 / 3) / 7], [11, 7], ["completed", "completed"])),
    ],
)
def test_score_is_what_pencil_and_paper_give_in_every_option(capsys, pencil, options, scores):
    mr, el, outcomes = scores
    status, out, err = score(capsys, pencil, "--image-size", "100x100", "--rate", "2", "--json", *options)
    scored = json.loads(out)
    rows = scored.get("trials", [scored])
    assert status == 0
    assert [row["mr"] for row in rows] == pytest.approx(mr)
    assert [row["el"] for row in rows] == el
    assert [row["outcome"] for row in rows] == outcomes
    assert [row["seconds"] for row in rows] == [steps / 2 for steps in el]
    assert ("left out: 1 trials of 7 steps or fewer" in err) is (len(rows) == 1)
    if len(rows) == 2:
        assert scored["mean"]["mr"] == pytest.approx(sum(mr) / 2)
        assert scored["std"]["mr"] == pytest.approx(abs(mr[0] - mr[1]) / 2**0.5)
        half = 12.7062 * scored["std"]["mr"] / 2**0.5  # t of one degree of freedom
        assert scored["interval"]["mr"] == pytest.approx([sum(mr) / 2 - half, sum(mr) / 2 + half], rel=1e-4)
        assert scored["mean"]["sr"] == outcomes.count("completed") / 2
        assert scored["censored"] == outcomes.count("completed")


def test_a_shorter_rule_of_lost_steps_ends_a_logged_trial_sooner(capsys, trials):
    _, out, _ = score(capsys, trials / "b", "--lost-steps", "3", "--json")
    scored = json.loads(out)
    assert (scored["outcome"], scored["el"], scored["mr"]) == ("lost", 8, 5 / 8)
    assert scored["ar"] == pytest.approx(8)
    assert scored["seconds"] == pytest.approx(0.4)
    assert "was not seen for 3 steps" in scored["reason"]


def test_the_floor_of_the_reward_is_an_option(capsys, tmp_path):
    a_trial(tmp_path, [a_step(0), a_step(1), a_step(2, bearing_rad=3.2)])
    wild = 1 - 3.2 / (np.pi / 4)
    for options, ar in (([], 1 + wild), (["--least-reward", "-1"], 0.0)):
        _, out, _ = score(capsys, tmp_path, "--json", *options)
        assert json.loads(out)["ar"] == pytest.approx(ar)


def test_boxes_that_are_none_cost_a_line_and_count_as_lost(capsys, tmp_path):
    (tmp_path / "good.txt").write_text("1 1 2 2\n1 1 2 2\n")
    (tmp_path / "odd.txt").write_text("1,1,2,2\nnan,nan,nan,nan\n1,1,-2,2\n0,0,0,0\n1,1,2,2\n")
    (tmp_path / "foreign.txt").write_text("Dear diary\n")
    (tmp_path / "picture.csv").write_bytes(b"\xff\xd8\xff")
    (tmp_path / "long.txt").write_text("1 1 2 2\n1 1 2 2\n")
    (tmp_path / "long.absent.txt").write_text("0\n0\n0\n")
    status, out, err = score(capsys, tmp_path, "--image-size", "9x9", "--json")
    assert status == 0
    assert [(row["mr"], row["bad_boxes"]) for row in json.loads(out)["trials"]] == [(1.0, 0), (1 / 4, 2)]
    for reason in (
        "foreign.txt: line 1: expected x,y,w,h or frame,id",
        "picture.csv: cannot be read as boxes (not a text file)",
        "long.absent.txt: expected 2 flags of 0 or 1, one for each box",
        "odd.txt: 2 boxes with NaN or a negative size",
    ):
        assert sum(reason in line for line in err.splitlines()) == 1
    assert len(err.splitlines()) == 4


def test_a_log_that_was_cut_short_is_scored_and_said(capsys, trials, tmp_path):
    content = (next(trials.glob("a/*")) / "trial.mcap").read_bytes()
    (tmp_path / "trial.mcap.part").write_bytes(content[: len(content) * 2 // 3])
    status, out, err = score(capsys, tmp_path, "--json")
    assert (status, json.loads(out)["complete"]) == (0, False)
    assert "cut short" in err


def test_csv_holds_a_line_a_trial_in_full_precision(capsys, pencil):
    file = pencil / "out" / "scores.csv"
    file.parent.mkdir()
    score(capsys, pencil / "a.txt", pencil / "b.txt", "--image-size", "100x100", "--csv", file)
    with file.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [Path(row["trial"]).name for row in rows] == ["a.txt", "b.txt"]
    assert [float(row["mr"]) for row in rows] == pytest.approx([5 / 11, 10 / 21], abs=1e-15)
    assert [row["platform"] for row in rows] == ["", ""]


def test_latex_has_the_papers_layout(capsys, tmp_path):
    for policy in ("ours_v2", "50 % & more"):
        for trial in range(2):
            steps = [a_step(step, box=None if step > 5 + 5 * trial else a_step(0).box) for step in range(11)]
            ends = {"outcome": "completed" if trial else "collision"}
            a_trial(tmp_path / policy / str(trial), steps, ends, policy=policy)
    score(capsys, tmp_path / "ours_v2", tmp_path / "50 % & more", "--latex", tmp_path / "table.tex")
    lines = (tmp_path / "table.tex").read_text().splitlines()
    head = r"\textbf{Platform} & \textbf{Method} & \textbf{MR} & \textbf{EL} & \textbf{SR} \\ \midrule"
    row = lines.index(head) + 1
    mr, el, sr = r"0.75 $\pm$ 0.35 [-2.43, 3.93]", r"10 $\pm$ 0 [10, 10]$^\dagger$", "0.50 [0.09, 0.91]"
    assert lines[row] == rf"drone & ours\_v2 & {mr} & {el} & {sr} \\"
    assert lines[row + 1].startswith(r" & 50 \% \& more & 0.75")
    assert lines[row + 2] == r"\bottomrule"


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


def test_without_a_size_one_is_taken_and_said_and_flags_named_beside_their_boxes_are_no_boxes(
    capsys, tmp_path
):
    boxes = "\n".join(["500,300,100,50", *["520,300,100,50"] * 2]) + "\n"
    for name, text in (("a.txt", boxes), ("a.absent.txt", "0\n1\n0\n"), ("b.txt", boxes)):
        (tmp_path / name).write_text(text)
    status, out, err = score(capsys, "--boxes", *sorted(tmp_path.iterdir()), "--json")
    assert status == 0
    assert [line.partition("scored as of")[2][:8] for line in err.splitlines()] == [" 640x360"] * 2
    assert [row["assumed_size"] for row in json.loads(out)["trials"]] == [[640, 360]] * 2
    assert [row["visibility"] for row in json.loads(out)["trials"]] == [0.5, 1.0]
    _, out, err = score(capsys, tmp_path / "b.txt", "--image-size", "640x360", "--json")
    assert (json.loads(out)["assumed_size"], err) == (None, "")


@pytest.mark.skipif(not BOXES.is_dir(), reason="needs ../shared/data/boxes, which is not part of the project")
def test_absent_flags_beside_a_file_are_read_with_it(capsys):
    boxes, absent = BOXES / "person-1.txt", BOXES / "person-1.absent.txt"
    _, beside, _ = score(capsys, "--boxes", boxes, "--image-size", "1280x720", "--json")
    _, named, _ = score(capsys, boxes, "--absent", absent, "--image-size", "1280x720", "--json")
    assert beside == named
    assert json.loads(beside)["visibility"] < 1


@pytest.mark.skipif(not BOXES.is_dir(), reason="needs ../shared/data/boxes, which is not part of the project")
@pytest.mark.parametrize("target", range(1, 20))
def test_recorded_crowds_score_as_ten_independent_lines_say(capsys, target):
    file = BOXES / "mot15-PETS09-S2L1" / "gt" / "gt.txt"
    _, out, _ = score(capsys, file, "--id", target, "--json")

    rows = np.loadtxt(file, delimiter=",")
    rows = rows[(rows[:, 1] == target) & (rows[:, 6] != 0)]
    seen = np.zeros(796 - int(rows[0, 0]), bool)
    seen[(rows[:, 0] - rows[0, 0]).astype(int)] = True
    track = np.zeros((len(seen), 4))
    track[seen] = rows[:, 2:6] / [768, 576, 768, 576]
    runs = np.convolve(~seen, np.ones(50))[: len(seen)] == 50
    end = int(runs.argmax()) + 1 if runs.any() else len(seen)
    off = track - track[0]
    centre, size = np.hypot(*(off[:, :2] + off[:, 2:] / 2).T), np.hypot(*off[:, 2:].T)
    r = np.where(seen, 1 / (1 + centre + size), 0)[1:end]

    scored = json.loads(out)
    assert scored["mr"] == pytest.approx(r.mean(), abs=1e-12)
    assert (scored["el"], scored["rate_hz"], scored["seconds"]) == (end - 1, 7, (end - 1) / 7)
    assert scored["visibility"] == pytest.approx(seen[1:end].mean())
    assert scored["outcome"] == ("lost" if runs.any() else "completed")


@pytest.fixture(scope="module")
def with_a_late_one(tmp_path_factory):
    """A trial that kept its timing, and one that missed a third of its slots."""
    folder = tmp_path_factory.mktemp("late")
    a_trial(folder / "a", [a_step(step) for step in range(11)])
    a_trial(
        folder / "b",
        [a_step(step, box=None if step else a_step(0).box, missed_deadlines=step // 2) for step in range(11)],
    )
    return folder


def test_a_trial_whose_timing_was_not_kept_is_said_and_left_out_unless_all_are_asked_for(
    capsys, with_a_late_one, tmp_path
):
    status, out, err = score(capsys, with_a_late_one, "--json", "--latex", tmp_path / "t.tex")
    assert (status, json.loads(out)["mean"]["mr"]) == (0, 1.0)
    assert "5 slots missed in 10 steps, 0% of its ticks stale; left out of means: --all counts it" in err
    assert "over 1 trials" in (tmp_path / "t.tex").read_text()
    _, out, err = score(capsys, with_a_late_one, "--json", "--all")
    assert json.loads(out)["mean"]["mr"] == 0.5
    assert err.rstrip().endswith("counted")
