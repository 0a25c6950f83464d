"""``train``: a wrong request is one line and status 2, Ctrl-C loses nothing, a resumed run ends the same."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from typing import get_args

import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.learning.data.collect import collect
from adatracker_deploy.learning.data.recipe import load_recipe
from adatracker_deploy.learning.train.settings import Variant
from adatracker_deploy.learning.train.snapshot import read_snapshot
from tests.tiers import EXHAUSTIVE

TINY = ("--recipe", "paper", "--rounds", "0", "--batch", "2", "--length", "20", "--threads", "1")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    collect(load_recipe("paper"), folder, steps=300, seed=4)
    return folder


def arguments(data, out, *more):
    return ["train", "--data", str(data), "--out", str(out), *TINY, *more]


def test_it_ends_with_the_checkpoints_path_and_one_json_object(data, tmp_path, capsys):
    assert main(arguments(data, tmp_path / "run", "--updates", "2", "--json")) == 0
    (line,) = capsys.readouterr().out.splitlines()
    told = json.loads(line)
    assert told["policy"] == str(tmp_path / "run" / "policy.pt")
    assert told["updates"] == 2
    assert (tmp_path / "run" / "policy.pt").is_file()


def test_awrs_critics_are_set_by_the_command(data, tmp_path):
    more = ("--method", "awr", "--critic-updates", "3", "--conservative", "0.05", "--updates", "1")
    assert main(arguments(data, tmp_path / "run", *more)) == 0
    kept = read_snapshot(tmp_path / "run").settings
    assert (kept.critic_updates, kept.conservative) == (3, 0.05)


def test_its_help_names_every_variant(capsys):
    with pytest.raises(SystemExit):
        main(["train", "--help"])
    told = "".join(capsys.readouterr().out.split())  # lines break at hyphens
    assert [name for name in get_args(Variant) if name not in told] == []


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        (["--response", "--variant", "no-encoder"], "--response: is part of the context"),
        (["--variant", "no-brakes"], "--variant: unknown 'no-brakes'; known are no-identification"),
        (["--updates", "0"], "updates: 0 is out of range"),
        (["--rounds", "-1"], "rounds: -1 is out of range"),
        (["--length", "1"], "length: 1 is out of range"),
        (["--critic-updates", "0"], "critic_updates: 0 is out of range"),
        (["--conservative", "-1"], "conservative: -1.0 is out of range"),
        (["--threads", "0"], "--threads: 0 is out of range"),
        (["--device", "warp"], "device 'warp' cannot be used"),
        (["--recipe", "gold"], "unknown recipe 'gold'"),
        (["--method", "magic"], "invalid choice: 'magic'"),
        (["--resume"], "to resume"),
    ],
)
def test_a_wrong_request_is_one_line_and_status_2(data, tmp_path, capsys, more, reason):
    assert main(arguments(data, tmp_path / "run", *more)) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert reason in printed.err
    assert not (tmp_path / "run").exists()


def test_a_damaged_shard_and_a_file_for_a_folder_are_status_2(data, tmp_path, capsys):
    damaged = tmp_path / "damaged"
    damaged.mkdir()
    whole = next(data.glob("shard-*.npz")).read_bytes()
    (damaged / "shard-00000.npz").write_bytes(whole[: len(whole) // 2])
    assert main(arguments(damaged, tmp_path / "run")) == 2
    assert "is damaged or cut short" in capsys.readouterr().err
    (tmp_path / "file").touch()
    assert main(arguments(data, tmp_path / "file" / "run")) == 2
    assert "cannot be made" in capsys.readouterr().err


@EXHAUSTIVE
def test_ctrl_c_saves_and_ends_with_130_and_the_rest_follows(data, tmp_path):
    command = [sys.executable, "-m", "adatracker_deploy"]
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    with subprocess.Popen(
        [*command, *arguments(data, cut, "--updates", "60")], stderr=subprocess.PIPE, text=True
    ) as process:
        assert "to update 60" in process.stderr.readline()  # it has begun, and can be interrupted
        os.kill(process.pid, signal.SIGINT)
        rest = process.stderr.read()
    assert process.returncode == 130
    assert rest.splitlines()[-1] == "adatracker-deploy: interrupted"
    for out, more in ((cut, ["--resume"]), (whole, [])):
        subprocess.run([*command, *arguments(data, out, "--updates", "60", *more)], check=True)
    assert (cut / "policy.pt").read_bytes() == (whole / "policy.pt").read_bytes()
