"""The ablation's statistics match hand computations, and its command trains and compares the variants."""

from __future__ import annotations

import json

import numpy as np
import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.evaluation.ablation import ArmScore, ablation_latex, ablation_record
from adatracker_deploy.learning.data.collect import collect
from adatracker_deploy.learning.data.recipe import load_recipe
from adatracker_deploy.learning.train.arms import ARMS, WHOLE, arms_of, of_arm
from adatracker_deploy.learning.train.settings import TrainSettings
from adatracker_deploy.scoring.stats.intervals import mean_difference
from tests.tiers import EXHAUSTIVE


def an_arm(name, *ars):
    return ArmScore(name, tuple({"ar": ar, "el": 500.0, "sr": 1.0} for ar in ars))


def test_a_difference_of_means_is_welchs():
    # Variances 4 and 7: 11 / 3 under the root, (11/3)^2 / ((4/3)^2/2 + (7/3)^2/2) = 3.7 degrees of freedom,
    # and t(3) = 3.182.
    found = mean_difference([10, 12, 14], [1, 2, 6])
    assert found.value == 9
    assert found.high - 9 == pytest.approx(3.1824 * np.sqrt(11 / 3), rel=1e-4)
    assert found.low == pytest.approx(18 - found.high)


def test_one_seed_bounds_nothing_and_equal_seeds_leave_no_doubt():
    assert mean_difference([3], [1, 2]).bounds == [None, None]
    assert mean_difference([3, 3], [1, 1]).bounds == [2, 2]
    with pytest.raises(ValueError, match="no values"):
        mean_difference([], [1])


def test_welchs_interval_covers_what_it_promises():
    rng = np.random.default_rng(0)
    pairs = [(rng.normal(1.0, 1.0, 3), rng.normal(0.0, 3.0, 4)) for _ in range(3000)]
    found = [mean_difference(list(ours), list(theirs)) for ours, theirs in pairs]
    covered = np.mean([each.low <= 1.0 <= each.high for each in found])
    assert 0.94 < covered < 0.99  # rounding the degrees of freedom down makes it cover somewhat more


def test_an_arm_is_compared_with_the_whole():
    whole, arm = an_arm("whole", 440, 450, 460), an_arm("no-encoder", 400, 410, 420)
    record = ablation_record([whole, arm])
    assert record["no-encoder"]["mean"]["ar"] == 410
    less, low, high = record["no-encoder"]["less"]["ar"]
    assert less == -40
    assert low < -40 < high < 0
    assert "less" not in record["whole"]
    assert "no-encoder & 410/500/1.00 & -40 [" in ablation_latex("field", [whole, arm])


@pytest.mark.parametrize(
    ("settings", "left_out"),
    [
        ({}, {"no-belief", "no-response"}),
        ({"belief": True, "response": True}, set()),
        ({"method": "awr", "belief": True, "response": True}, {"no-search"}),
        (
            {"method": "awr", "variants": ("no-last-action",)},
            {"no-search", "no-belief", "no-response", "no-last-action", "neither"},
        ),
    ],
)
def test_the_arms_are_those_that_leave_something_out_and_no_two_are_the_same(settings, left_out):
    whole = TrainSettings(recipe="deploy", **settings)
    arms = arms_of(whole)
    assert {*arms} == {*ARMS} - {WHOLE} - left_out
    runs = [of_arm(whole, arm, 0) for arm in (WHOLE, *arms)]
    assert all(run not in runs[:index] for index, run in enumerate(runs))
    assert not of_arm(whole, "no-belief", 0).belief
    assert not of_arm(whole, "no-response", 0).response


@EXHAUSTIVE
def test_the_table_comes_from_one_command_which_keeps_what_is_finished(tmp_path, capsys):
    data, out = tmp_path / "data", tmp_path / "out"
    collect(load_recipe("paper"), data, steps=300, seed=4)
    command = [
        *("ablate", "--data", str(data), "--out", str(out), "--recipe", "paper", "--arm", "no-encoder"),
        *("--seeds", "1", "--updates", "2", "--rounds", "0", "--condition", "clean", "--episodes", "1"),
        *("--steps", "5", "--workers", "1", "--latex", str(tmp_path / "table.tex"), "--json"),
    ]
    assert main(command) == 0
    (first,) = capsys.readouterr().out.splitlines()
    kept = {path: path.stat().st_mtime_ns for path in out.rglob("*.onnx")}
    assert len(kept) == 3  # whole: an encoder and a policy, no-encoder: a policy
    assert main(command) == 0
    assert capsys.readouterr().out.strip() == first
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*.onnx")} == kept
    assert main([*command, "--round-steps", "7"]) == 2
    assert "its run has round_steps" in capsys.readouterr().err
    arms = json.loads(first)["clean"]
    assert list(arms) == ["whole", "no-encoder"]
    assert [len(arm["seeds"]) for arm in arms.values()] == [1, 1]
    assert "toprule" in (tmp_path / "table.tex").read_text()


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (("--arm", "no-camera"), "unknown 'no-camera'"),
        (("--arm", "no-belief"), "--arm no-belief: leaves out nothing here"),
        (("--variant", "no-camera"), "--variant: unknown 'no-camera'"),
        (("--seeds", "0"), "--seeds: 0 is out of range"),
        (("--condition", "rain"), "unknown condition 'rain'"),
        (("--updates", "0"), "updates"),
    ],
)
def test_a_wrong_request_is_one_line(tmp_path, capsys, wrong, says):
    assert main(["ablate", "--data", str(tmp_path), "--out", str(tmp_path / "out"), *wrong]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert says in line
    assert not (tmp_path / "out").exists()
