"""A stop whose exception Python has swallowed ends the trial all the same, in whatever phase it came."""

from __future__ import annotations

import os
import signal
import sys

import pytest

from adatracker_deploy.app.trial_run import run_trial
from adatracker_deploy.runtime.operator_stop import StopRequest
from adatracker_deploy.testing.fake import fake_profile
from tests.trial.plans import fake_plan

STEPS = 40


class Finalized:
    """Is being finalized when somebody presses Ctrl-C: what is raised there, Python only prints."""

    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)


class Unlucky:
    """Progress that loses the exception of a stop at the beginning of a phase."""

    def __init__(self, when):
        self.when = when
        self.lost = False
        self.steps = 0

    def phase(self, text):
        if text.startswith(self.when):
            self.lost = True
            Finalized()

    def logging(self, folder): ...

    def step(self, record):
        self.steps += 1


@pytest.mark.parametrize("when", ["connecting", "engaging", "looking", "following"])
def test_a_stop_that_python_has_swallowed_ends_the_trial(tmp_path, monkeypatch, when):
    monkeypatch.setattr(sys, "unraisablehook", lambda _: None)
    plan = fake_plan(fake_profile(), tmp_path, STEPS)
    unlucky, stop = Unlucky(when), StopRequest()
    with stop.listening(), stop.trial():
        summary = run_trial(plan, unlucky, 0.0, stop)
    assert unlucky.lost
    assert summary["outcome"] == "interrupted"
    assert unlucky.steps < STEPS
