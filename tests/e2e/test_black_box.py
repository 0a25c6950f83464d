"""After link and tracker are killed, report and replay show their last state from the link's black box."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import time

import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.runtime.black_box import FILE_NAME, read_black_box
from adatracker_deploy.runtime.link import Phase
from tests.report.pages import Page

from .conftest import COMMAND, Flight, gone

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]
PATIENCE_S = 60.0


def until(condition, process=None):
    give_up_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert process is None or process.poll() is None, process.communicate()
        assert time.monotonic() < give_up_s
        time.sleep(0.01)


def recorded(folder):
    """Return the moments so far in the black box of the trial in a folder."""
    with contextlib.suppress(OSError, ValueError, StopIteration):
        return read_black_box(next(folder.glob(f"*/{FILE_NAME}")))
    return ()


def test_report_and_replay_read_it_after_both_were_killed(tmp_path, capsys):
    trials = tmp_path / "trials"
    run = Flight(
        [*COMMAND, "--platform", "wheeled", "--sitl", "--segmenter", "truth", "--steps", "2000"], tmp_path
    )
    with run.process:
        try:
            until(lambda: any(moment.status.sent.vx > 0.3 for moment in recorded(trials)[-50:]), run.process)
            link = run.link_pid()
            os.kill(run.pid, signal.SIGSTOP)
            until(lambda: recorded(trials)[-1].status.phase is Phase.HOLDING)
        finally:
            with contextlib.suppress(ValueError):
                os.kill(run.link_pid(), signal.SIGKILL)
            run.process.kill()
    until(lambda: gone(link))
    (folder,) = trials.iterdir()
    page = tmp_path / "page.html"
    assert main(["report", str(folder), "--out", str(page)]) == 0
    text = Page(page.read_text()).text
    assert "the link's black box" in text
    assert "command_lost" in text
    capsys.readouterr()
    assert main(["replay", str(folder), "--json"]) == 0
    after = json.loads(capsys.readouterr().out)["after_log"]
    assert [change["phase"] for change in after["changes"]][-1] == "holding"
    assert after["told_s"] < 0.3
