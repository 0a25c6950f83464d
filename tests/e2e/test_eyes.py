"""By default a rehearsal looks with the robot's own eyes, and the log knows what they were worth."""

from __future__ import annotations

import json

import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.trial.reader import read_trial
from tests.tiers import EXHAUSTIVE

from .conftest import started

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]

STEPS = 120


@EXHAUSTIVE
@pytest.mark.parametrize("platform", ["wheeled", "quadruped", "drone"])
def test_every_robot_finds_and_follows_its_target_in_rendered_pictures(
    tmp_path, profile, capsys, measured, platform
):
    own = ("--profile", str(profile)) if platform == "drone" else ()
    with started(tmp_path, "--platform", platform, "--sitl", *own) as start:
        run = start("--seed", "1", "--steps", str(STEPS), "--others", "1", "--json")
        status, summary, err = run.end(timeout_s=200)
    assert status == 0, err
    assert (summary["outcome"], summary["el"]) == ("completed", STEPS)
    sight = summary["sight"]
    assert sight["seen"] > 0.9
    assert sight["somebody_else"] < 0.02
    assert sight["mask_iou"] > 0.75
    (folder,) = (tmp_path / "trials").iterdir()
    trial = read_trial(folder)
    assert "nanodet" in trial.config["segmenter"]
    assert next(trial.frames()).rgb.shape == (480, 640, 3)
    capsys.readouterr()
    assert main(["score", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["sight"] == sight
    mr, rate_hz = summary["mr"], summary["rate_hz"]
    measured(f"{platform}, by its own eyes: MR {mr:.3f}, mask IoU {sight['mask_iou']:.2f}, {rate_hz:.2f} Hz")
