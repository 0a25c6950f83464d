"""A closed pipe ends the command silently; a full disk under its output ends it with one line on stderr."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from adatracker_deploy.cli import main
from tests.report.pages import write_trial
from tests.trial.records import a_step

COMMAND = (sys.executable, "-m", "adatracker_deploy")


@pytest.fixture(scope="module")
def trials(tmp_path_factory):
    folder = tmp_path_factory.mktemp("trials")
    for number in range(3):
        write_trial(folder / str(number), [a_step(step) for step in range(5)], summary={"outcome": "lost"})
    return folder


@pytest.mark.parametrize("arguments", [("trials",), ("trials", "--csv"), ("score",), ("score", "--json")])
def test_a_reader_that_has_gone_is_no_error_to_tell_of(trials, arguments):
    name, *options = arguments
    with subprocess.Popen(
        (*COMMAND, name, trials, *options), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        running.stdout.close()  # before a line is written, so that whatever the buffers hold must fail
        _, err = running.communicate(timeout=60)
    assert (running.returncode, err) == (1, "")


@pytest.mark.parametrize("arguments", [("trials",), ("trials", "--json"), ("score",)])
def test_a_full_disk_under_the_output_is_told_in_a_line(trials, arguments):
    name, *options = arguments
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            (*COMMAND, name, trials, *options), stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert done.returncode == 1
    assert done.stderr == ("adatracker-deploy: the output could not be written (No space left on device)\n")


def test_help_does_not_promise_that_nothing_at_all_runs_a_robot(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    words = " ".join(capsys.readouterr().out.split())
    assert "Without a command it runs" not in words
    assert "--platform drone --sitl" in words
    assert main([]) == 2  # which is why
