"""The line that shows how a trial goes."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from adatracker_deploy.cli.progress import Progress
from adatracker_deploy.core.record import Latency
from tests.trial.records import a_step

NOT_ASKED = Latency(observation_age_ms=300, infer_ms=0, sensor_to_command_ms=300, lateness_ms=0.1)


@pytest.mark.parametrize(
    ("changes", "said", "not_said"),
    [
        ({}, "10/600", "target lost"),
        ({"box": None}, "target lost", "frame too old"),
        ({"box": None}, "target lost", "searching"),
        ({"box": None, "searching": True}, "target lost, searching", "frame too old"),
        ({"box": None, "stale": True, "latency": NOT_ASKED}, "frame too old", "target lost"),
        ({"box": None, "stale": True}, "answer too late", "target lost"),
    ],
)
def test_a_stale_step_is_not_shown_as_a_lost_one(changes, said, not_said):
    console = Console(file=io.StringIO(), width=200)
    Progress(console, 600, lambda folder: None).step(a_step(10, **changes))
    assert said in console.file.getvalue()
    assert not_said not in console.file.getvalue()
