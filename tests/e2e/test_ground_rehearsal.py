"""The wheeled base and the quadruped follow a person by their own wires; then all three robots do."""

from __future__ import annotations

import json
import os

import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.trial.reader import read_trial
from tests.tiers import EXHAUSTIVE

from .conftest import COMMAND, Flight, follow_to_the_horizon

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]


@EXHAUSTIVE  # `test_eyes` has a drone do so, and all three robots complete below
@pytest.mark.parametrize("platform", ["wheeled", "quadruped"])
def test_a_ground_robot_follows_to_the_horizon(tmp_path, measured, platform):
    summary = follow_to_the_horizon(platform, tmp_path)
    (folder,) = (tmp_path / "trials").iterdir()
    assert json.loads((folder / "summary.json").read_text())["mr"] == summary["mr"]
    measured(f"{platform}: MR {summary['mr']:.3f}, AR {summary['ar']:.0f}, {summary['rate_hz']:.2f} Hz")


@EXHAUSTIVE
def test_what_the_kernel_gave_to_loop_and_link_is_told_and_logged_and_so_are_the_stages(tmp_path):
    core = min(os.sched_getaffinity(0))
    run = Flight(
        [
            *(*COMMAND, "--platform", "wheeled", "--sitl", "--policy", "pid", "--json"),
            *("--steps", "20", "--cpu", str(core), "--segmenter", "truth"),
        ],
        tmp_path,
    )
    _, summary, err = run.end(timeout_s=120)
    one = f"ordinary priority on cores {core}"
    assert f"loop: {one}; link: {one}" in err
    (folder,) = (tmp_path / "trials").iterdir()
    trial = read_trial(folder)
    assert f"loop: {one}; link: {one}" in [event.message for event in trial.events]
    assert (trial.config["realtime"], trial.config["cpus"]) == (False, [core])
    assert all(found["p50"] is not None for found in summary["stages_ms"].values()), summary
    assert summary["stages_ms"]["sensor_to_wire"]["p50"] > summary["latency_ms"]["p50"]


@EXHAUSTIVE
def test_a_trial_whose_pictures_were_not_kept_is_scored_and_replayed_all_the_same(tmp_path, capsys):
    run = Flight(
        [*COMMAND, "--platform", "wheeled", "--sitl", "--steps", "10", "--no-frames", "--json"], tmp_path
    )
    status, summary, err = run.end(timeout_s=120)
    assert status == 0, err
    assert summary["outcome"] == "completed"
    (folder,) = (tmp_path / "trials").iterdir()
    trial, page = read_trial(folder), tmp_path / "page.html"
    assert (trial.frames_kept, len(trial.frame_seqs)) == ("none", 0)
    assert "--no-frames" in trial.about["command"]
    assert main(["score", str(folder)]) == 0
    assert main(["replay", str(folder)]) == 0
    assert main(["report", str(folder), "--out", str(page)]) == 0
    assert "Frames were left out" in page.read_text()
    capsys.readouterr()
    assert main(["filmstrip", str(folder), "--out", str(tmp_path / "strip.png")]) == 2
    assert "no camera frames in it" in capsys.readouterr().err


@EXHAUSTIVE
def test_all_three_robots_print_the_papers_table(tmp_path):
    run = Flight(
        [
            *(*COMMAND, "--platform", "wheeled,quadruped,drone", "--sitl", "--json"),
            *("--trials", "2", "--steps", "60", "--speed", "2", "--segmenter", "truth"),
        ],
        tmp_path,
    )
    status, summary, err = run.end(timeout_s=200)
    assert status == 0, err
    assert [group["platform"] for group in summary["groups"]] == ["wheeled", "quadruped", "drone"]
    for name in ("wheeled", "quadruped", "drone"):
        rows = [line.split() for line in err.splitlines() if line.split()[:3] == [name, "adatracker", "2"]]
        assert len(rows) == 1, err
        assert rows[0].count("±") == 2
