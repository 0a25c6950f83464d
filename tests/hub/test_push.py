"""A policy is published with its card, trials as a dataset, and nobody's picture by mistake."""

from __future__ import annotations

import csv
import io

import pytest
import yaml
from huggingface_hub import constants

from adatracker_deploy.cli import main
from adatracker_deploy.policy.catalogue import DEFAULT, load_policy
from adatracker_deploy.trial.reader import read_trial
from tests.hub.server import TOKEN
from tests.policy import tiny
from tests.trial.records import a_frame, a_log, a_step, an_observation

SUMMARY = {"outcome": "completed", "mr": 0.9, "el": 3, "steps": 5, "seconds": 0.2, "timing_kept": True}


@pytest.fixture
def owner(hub, monkeypatch):
    monkeypatch.setenv("HF_TOKEN", TOKEN)
    return hub


def pushed(capsys, *arguments):
    assert main(["push", *map(str, arguments)]) == 0
    return capsys.readouterr().out.splitlines()


def refusal(capsys, *arguments):
    assert main(["push", *map(str, arguments)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    return line


def header(card):
    return yaml.safe_load(card.decode().split("---\n")[1])


def a_trial(folder, *, virtual=False, frames="full", pictures=True, note=""):
    truth = {} if virtual else {"target_visible": None, "distance_m": None, "bearing_rad": None}
    with a_log(folder, kind="sitl" if virtual else "real", frames=frames, config={"frames": frames}) as log:
        for number in range(3):
            frame = a_frame(number) if pictures else None
            log.step(a_step(number, **truth), frame, an_observation(number) if pictures else None)
        log.close(SUMMARY | {"trial": str(log.folder)})
    return log.folder


def test_a_policy_comes_back_as_it_was_pushed(owner, capsys, tmp_path):
    tiny.Parts().write(tmp_path / "mine")
    (tmp_path / "mine" / "MODEL_CARD.md").write_text("# Mine\n\nFollows people.\n")
    (tmp_path / "mine" / "notes.txt").write_text("for me alone")
    said, url = pushed(capsys, tmp_path / "mine", "hf://lab/mine")
    name = said.removesuffix(" (private)")
    assert url.endswith(f"/lab/mine/commit/{name.partition('@')[2]}")
    files = owner.repos["model", "lab/mine"].files("main")
    assert files.keys() == {
        ".gitattributes", "README.md", "encoder.onnx", "golden.npz", "manifest.yaml", "policy.onnx"
    }  # fmt: skip
    assert header(files["README.md"])["license"] == "cc0-1.0"
    assert b"# Mine\n\nFollows people." in files["README.md"]
    assert b"--policy hf://lab/mine@main" in files["README.md"]
    assert load_policy(name).info.sha256 == load_policy(str(tmp_path / "mine")).info.sha256


def test_it_is_public_where_that_is_asked_for_and_a_card_is_made_where_there_is_none(owner, capsys, tmp_path):
    tiny.Parts().write(tmp_path / "mine")
    said, _ = pushed(capsys, tmp_path / "mine", "hf://lab/mine", "--public")
    assert said.endswith(" (public)")
    card = owner.repos["model", "lab/mine"].files("main")["README.md"].decode()
    assert "# tiny\n\nrandom weights" in card
    assert "10 Hz; drives yaw, forward; masks of 8 x 8." in card


def test_the_shipped_policy_can_be_pushed_and_again(owner, capsys):
    first, _ = pushed(capsys, DEFAULT, "hf://lab/default")
    again, _ = pushed(capsys, DEFAULT, "hf://lab/default")
    assert first == again  # nothing has changed: no other commit
    assert header(owner.repos["model", "lab/default"].files("main")["README.md"])["license"] == "apache-2.0"


def test_trials_become_a_dataset_with_an_index_that_grows(owner, capsys, tmp_path):
    first = a_trial(tmp_path / "a", virtual=True)
    pushed(capsys, first, "hf://datasets/lab/trials", "--licence", "CC-BY-4.0")
    second = a_trial(tmp_path / "b", pictures=False)
    pushed(capsys, tmp_path / "b", "hf://datasets/lab/trials", "--licence", "CC-BY-4.0")
    files = owner.repos["dataset", "lab/trials"].files("main")
    rows = list(csv.DictReader(io.StringIO(files["trials.csv"].decode())))
    assert sorted(row["trial"] for row in rows) == sorted([first.name, second.name])
    assert {row["outcome"] for row in rows} == {"completed"}
    assert header(files["README.md"]) | {"tags": None, "configs": None} == {
        "license": "cc-by-4.0", "pretty_name": "trials", "tags": None, "configs": None
    }  # fmt: skip
    assert all(name in files["README.md"].decode() for name in (first.name, second.name))
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(files[f"trials/{first.name}/trial.mcap"])
    assert len(read_trial(copy).frame_seqs) == 3


def test_pictures_of_real_people_are_published_only_where_that_is_agreed_to(owner, capsys, tmp_path):
    trial = a_trial(tmp_path)
    words = (trial, "hf://datasets/lab/trials", "--licence", "CC-BY-4.0")
    line = refusal(capsys, *words)
    assert "--blur or --no-frames" in line
    assert ("dataset", "lab/trials") not in owner.repos
    pushed(capsys, *words, "--with-pictures")
    assert ("dataset", "lab/trials") in owner.repos


@pytest.mark.parametrize("frames", ["blurred", "none"])
def test_trials_that_ran_blurred_or_without_pictures_are_published(owner, capsys, tmp_path, frames):
    pushed(capsys, a_trial(tmp_path, frames=frames), "hf://datasets/lab/t", "--licence", "other")


def test_what_cannot_be_published_is_refused_and_nothing_is_made(owner, capsys, tmp_path):
    tiny.Parts().write(tmp_path / "mine")
    trial = a_trial(tmp_path / "trials", virtual=True)
    licence = ("--licence", "MIT")
    assert "has no bundle" in refusal(capsys, "pid", "hf://lab/x")
    assert "has no bundle" in refusal(capsys, "ws://gpu:8000", "hf://lab/x")
    assert "is no address on the Hub" in refusal(capsys, tmp_path / "mine", "lab/x")
    assert "takes one policy" in refusal(capsys, trial, trial, "hf://lab/x")
    assert "go to hf://datasets/" in refusal(capsys, trial, "hf://lab/x")
    assert "go to hf://datasets/" in refusal(capsys, tmp_path / "trials", "hf://lab/x")
    assert "is for trials" in refusal(capsys, tmp_path / "mine", "hf://lab/x", "--licence", "MIT")
    assert "say which with --licence" in refusal(capsys, trial, "hf://datasets/lab/x")
    assert "no trials in it" in refusal(capsys, tmp_path / "mine", "hf://datasets/lab/x", *licence)
    assert "has the same name" in refusal(capsys, trial, trial, "hf://datasets/lab/x", *licence)
    (trial / "trial.mcap").rename(trial / "trial.mcap.part")
    assert "is not finished" in refusal(capsys, trial, "hf://datasets/lab/x", *licence)
    (tmp_path / "mine" / "policy.onnx").write_bytes(b"other")
    assert "policy.onnx: has changed" in refusal(capsys, tmp_path / "mine", "hf://lab/x")
    assert owner.repos == {}


def test_without_a_token_the_hub_refuses_in_a_sentence(hub, capsys, tmp_path):
    tiny.Parts().write(tmp_path / "mine")
    assert "with HF_TOKEN, or after 'hf auth login'" in refusal(capsys, tmp_path / "mine", "hf://lab/mine")


def test_without_a_network_it_says_so(owner, no_network, monkeypatch, capsys, tmp_path):
    tiny.Parts().write(tmp_path / "mine")
    no_network()
    assert "the Hub cannot be reached" in refusal(capsys, tmp_path / "mine", "hf://lab/mine")
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", True)
    assert "HF_HUB_OFFLINE is set" in refusal(capsys, tmp_path / "mine", "hf://lab/mine")


def test_somebody_elses_table_is_not_overwritten(owner, capsys, tmp_path):
    owner.add("lab/theirs", {"trials.csv": b"time,place\n1,2\n"}, kind="dataset")
    trial = a_trial(tmp_path, virtual=True)
    assert "holds another trials.csv" in refusal(
        capsys, trial, "hf://datasets/lab/theirs", "--licence", "CC-BY-4.0"
    )
