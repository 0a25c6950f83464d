"""The command keeps its contract: exit status, one JSON object, and what is finished when it is stopped."""

from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import sys

import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.evaluation import play
from tests.policy import tiny
from tests.tiers import EXHAUSTIVE

SHORT = ("evaluate", "--episodes", "1", "--steps", "3", "--workers", "1")


def test_pid_is_scored_and_everything_is_written(capsys, tmp_path):
    latex, picture = tmp_path / "grid.tex", tmp_path / "grid.png"
    command = [*SHORT, "--policy", "pid", "--json", "--latex", str(latex), "--picture", str(picture)]
    assert main(command) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["complete"]
    assert record["policies"]["pid"]["mean"]["el"] == 3
    assert latex.read_text().startswith(r"\begin{table*}")
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_the_default_is_the_shipped_bundle(capsys):
    assert main([*SHORT, "--json"]) == 0
    assert list(json.loads(capsys.readouterr().out)["policies"]) == ["adatracker"]


def test_the_same_seed_gives_the_same_scores_and_another_gives_others(capsys):
    def scores(seed):
        assert main([*SHORT, "--json", "--condition", "hard", "--seed", seed]) == 0
        return json.loads(capsys.readouterr().out)["policies"]

    assert scores("1") == scores("1") != scores("2")


def stopped_after(episodes, reason):
    def playing(plan, workers):
        yield from itertools.islice(real(plan, workers), episodes)
        raise reason

    real = play.play_all
    return playing


def test_an_interrupted_run_shows_what_is_finished_and_exits_130(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(play, "play_all", stopped_after(20, KeyboardInterrupt()))
    latex = tmp_path / "grid.tex"
    arguments = [*SHORT, "--episodes", "2", "--json", "--latex", str(latex)]
    assert main(arguments) == 130
    out, err = capsys.readouterr()
    record = json.loads(out)
    assert (record["played"], record["complete"]) == (20, False)
    assert latex.exists()
    assert "(20 of 32 episodes)" in err
    assert err.strip().endswith("interrupted")


def test_a_run_stopped_before_its_first_episode_says_so_and_nothing_else(capsys, monkeypatch):
    monkeypatch.setattr(play, "play_all", stopped_after(0, KeyboardInterrupt()))
    assert main([*SHORT, "--json"]) == 130
    assert capsys.readouterr() == ("", "adatracker-deploy: interrupted\n")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--policy", "genius"), "unknown policy 'genius'"),
        (("--policy", "pid", "--policy", "pid"), "named twice"),
        (("--condition", "storm"), "unknown condition"),
        (("--scene", "moon"), "unknown scene"),
        (("--episodes", "0"), "episodes: 0"),
        (("--workers", "0"), "--workers: 0"),
        (("--picture", "grid.jpg"), "ends in .png"),
        (("--swap",), "--swap needs --context"),
        (("--recipe", "wide"), "--recipe needs --context"),
        (("--context", "z.png", "--policy", "pid", "--policy", "adatracker"), "studies one policy"),
        (("--context", "z.png", "--policy", "pid"), "no context encoder"),
        (("--context", "z.png", "--policy", "pid", "--latex", "t.tex"), "show the grid"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(capsys, arguments, words):
    assert main([*SHORT, *arguments]) == 2
    out, err = capsys.readouterr()
    (line,) = err.strip().splitlines()
    assert out == ""
    assert words in line


def test_a_bundle_is_scored_where_there_is_no_torch_and_no_matplotlib(tmp_path):
    tiny.Parts().write(tmp_path)
    arguments = [*SHORT, "--policy", str(tmp_path)]
    code = (
        "import sys; sys.modules.update(torch=None, matplotlib=None, gymnasium=None)\n"
        f"from adatracker_deploy.cli import main; sys.exit(main({arguments!r}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "tiny  " in done.stdout


@EXHAUSTIVE
@pytest.mark.slow
@pytest.mark.parametrize(
    "began_deaf",
    [False, True],
    ids=["in a terminal", "as a script's background job"],
)
def test_ctrl_c_in_the_middle_of_parallel_work_leaves_json_and_no_traceback(began_deaf):
    command = [sys.executable, "-m", "adatracker_deploy", "evaluate", "--workers", "2", "--json"]
    if began_deaf:  # what a shell without job control does to what it starts with &
        command = ["sh", "-c", "trap '' INT; exec \"$@\"", "sh", *command]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        try:
            assert "episodes" in process.stderr.readline()
            os.killpg(process.pid, signal.SIGINT)
            out, err = process.communicate(timeout=60)  # the end of its output is the end of all workers
        except BaseException:
            os.killpg(process.pid, signal.SIGKILL)
            raise
    assert process.returncode == 130
    assert json.loads(out)["played"] > 0
    assert "Traceback" not in err
