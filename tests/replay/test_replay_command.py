"""``adatracker-deploy replay``."""

from __future__ import annotations

import json
import re

import cv2
import numpy as np
import pytest
import yaml

from adatracker_deploy.cli import main
from adatracker_deploy.policy.bundle import load_bundle
from adatracker_deploy.policy.onnx_policy import OnnxPolicy
from adatracker_deploy.policy.pid import PidPolicy
from adatracker_deploy.registry import profile_dir
from tests.policy import tiny
from tests.replay.trials import logged, observations


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bundles") / "mine"
    tiny.Parts().write(folder)
    return folder


@pytest.fixture
def trial(bundle, tmp_path):
    return logged(tmp_path, OnnxPolicy(load_bundle(bundle)), observations(30))


def replay(capsys, *arguments):
    """Return (exit status, stdout, stderr)."""
    status = main(["replay", *map(str, arguments)])
    return status, *capsys.readouterr()


def test_the_same_bundle_answers_the_same_and_exits_with_0(capsys, trial, bundle):
    status, out, err = replay(capsys, trial, "--policy", bundle)
    assert (status, err) == (0, "")
    assert out.splitlines() == [
        "policy tiny: 30 ticks re-run",
        "every action and every z is the same to the bit",
    ]


def test_one_number_off_by_its_last_bit_exits_with_1_and_is_named(capsys, bundle, tmp_path):
    trial = logged(tmp_path, OnnxPolicy(load_bundle(bundle)), observations(30), nudged={12, 20})
    status, out, _ = replay(capsys, trial, "--policy", bundle, "--json")
    record = json.loads(out)
    assert (status, record["equal"], record["same_policy"]) == (1, False, True)
    first = record["first_difference"]
    assert (first["tick"], first["what"], first["place"]) == (12, "action", 1)
    assert 0 < first["by"] < 1e-7
    assert any("round differently" in note for note in record["notes"])
    assert (
        "not the same; first at tick 12, action[1]: logged " in replay(capsys, trial, "--policy", bundle)[1]
    )


def test_a_version_that_was_another_is_told_where_answers_differ(capsys, tmp_path):
    trial = logged(tmp_path, PidPolicy(), observations(10), nudged={0}, about={"numpy": "0.9"})
    status, out, _ = replay(capsys, trial)
    assert status == 1
    assert f"numpy was 0.9 then, is {np.__version__} now" in out


def test_without_a_name_the_logs_own_is_asked(capsys, tmp_path):
    trial = logged(tmp_path, PidPolicy(), observations(10))
    assert replay(capsys, trial)[0] == 0


def test_a_name_that_is_known_nowhere_asks_for_the_bundle(capsys, trial):
    status, out, err = replay(capsys, trial)
    assert (status, out) == (2, "")
    assert "unknown policy 'tiny'" in err
    assert "say where its bundle is with --policy DIR" in err


def test_another_bundle_of_the_same_name_is_named_by_its_files(capsys, trial, tmp_path):
    other = tmp_path / "other"
    parts = tiny.Parts("window")
    parts.write(other)
    status, out, _ = replay(capsys, trial, "--policy", other, "--json")
    record = json.loads(out)
    assert (status, record["same_policy"]) == (0, False)
    assert "another bundle of that name, by SHA-256: encoder.onnx " in record["notes"][0]
    assert "an open loop" in record["notes"][1]


def test_another_policy_is_no_failure_and_how_far_it_is_off_is_told(capsys, trial, tmp_path):
    plot = tmp_path / "plot.png"
    status, out, _ = replay(capsys, trial, "--policy", "pid", "--plot", plot)
    assert status == 0
    assert "not the same; first at tick 0, z: 0 numbers, in the log 3" in out
    assert "vx m/s" in out
    assert "another policy: the log is of tiny, this is pid" in out
    assert "made for 20 Hz and was asked at the log's 10.0 Hz" in out
    picture = cv2.imread(str(plot))
    assert picture.shape[1] == 1200
    for colour in ((190, 105, 33), (25, 110, 225)):  # blue and orange, as OpenCV reads them
        assert (picture == colour).all(axis=2).any()


def test_what_damage_left_in_a_log_is_compared_and_drawn_like_the_rest(capsys, tmp_path):
    trial = logged(tmp_path, PidPolicy(), observations(10))
    data = trial.read_bytes()
    number = re.search(rb'"action":\[(-?[0-9.]{12,}),', data)[1]
    trial.write_bytes(data.replace(number, b"9e300".ljust(len(number))))
    status, out, _ = replay(capsys, trial, "--plot", tmp_path / "plot.png", "--profile", "scout")
    assert status == 1
    assert "action[0]: logged 9e+300, now " in out


def test_a_gap_is_said_and_what_is_before_it_compared(capsys, tmp_path):
    trial = logged(tmp_path, PidPolicy(), observations(20), missing={8}, stale={2})
    status, out, _ = replay(capsys, trial, "--json")
    record = json.loads(out)
    assert (status, record["equal"], record["compared"], record["idle"]) == (0, True, 7, 1)
    assert record["gap"] == {"tick": 8, "why": "the log lacks this tick"}
    assert "nothing can be compared" in record["notes"][0]


def test_a_log_that_was_cut_short_is_replayed_as_far_as_it_goes(capsys, tmp_path):
    trial = logged(tmp_path, PidPolicy(), observations(20))
    part = tmp_path / "trial.mcap.part"
    part.write_bytes(trial.read_bytes()[: trial.stat().st_size * 3 // 4])
    trial.unlink()
    status, out, _ = replay(capsys, tmp_path)
    assert status == 0
    assert "the log was cut short: replayed up to its last whole record" in out


def test_another_profiles_limits_judge_the_commands_again(capsys, trial, bundle, tmp_path):
    document = yaml.safe_load((profile_dir() / "scout.yaml").read_text())
    document["limits"] |= {"forward_m_s": 0.001, "backward_m_s": 0.001, "fence_radius_m": 50.0}
    slow = tmp_path / "slow.yaml"
    slow.write_text(yaml.safe_dump(document))
    status, out, _ = replay(capsys, trial, "--policy", bundle, "--profile", slow, "--json")
    gate = json.loads(out)["gate"]
    assert status == 0
    assert gate["limits"]["forward_m_s"] == {"trial": 1.5, "here": 0.001}
    clipped = {
        name: sum(b - a + 1 for a, b in gate[name]["reasons"]["envelope"]) for name in ("trial", "here")
    }
    assert clipped["here"] == 30 > clipped["trial"]
    assert gate["differences"]["vx"]["most"] > 0
    status, out, _ = replay(capsys, trial, "--policy", bundle, "--profile", slow)
    assert "forward_m_s: 1.5 -> 0.001" in out
    assert "under the trial's own limits this judgement differs from the sent command by" in out


@pytest.mark.parametrize(
    ("config", "words"),
    [
        ({"profile": {"limits": {}}, "seed": 0}, "limits: missing key 'forward_m_s'"),
        ({"seed": 0}, "lacks the robot's limits"),
        ({"profile": {"limits": {}}}, "limits: missing key"),
        ({}, "lacks the robot's limits"),
    ],
)
def test_a_log_that_does_not_say_enough_is_refused(capsys, tmp_path, config, words):
    trial = logged(tmp_path, PidPolicy(), observations(3), config=config)
    status, out, err = replay(capsys, trial)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert words in err


def test_a_trial_that_nobody_acted_in_is_nothing_to_replay(capsys, tmp_path):
    trial = logged(tmp_path, PidPolicy(), observations(3), stale={0, 1, 2})
    status, _, err = replay(capsys, trial)
    assert status == 2
    assert "there is nothing to replay (no tick was acted on)" in err
