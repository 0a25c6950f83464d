"""The command with short trials, as a process: each names a file, and ends when that file is there."""

from __future__ import annotations

import sys
import threading
from pathlib import Path

import adatracker_deploy.app.trial_run
from adatracker_deploy.cli import main
from adatracker_deploy.scoring.summary import summarise_log
from adatracker_deploy.trial.reader import read_scored
from tests.report.pages import write_trial
from tests.trial.records import a_step


def short_trial(plan, progress, started_s, stop):
    number = len(list(plan.log_dir.iterdir())) + 1
    over = plan.log_dir.with_name(f"over-{number}")
    print(f"until {over}", flush=True)
    while not over.exists():
        threading.Event().wait(0.01)
    folder = plan.log_dir / str(number)
    write_trial(folder, [a_step(n) for n in range(21)], summary={"outcome": "completed"}, frames=False)
    return summarise_log(read_scored(folder))


if __name__ == "__main__":
    Path(sys.argv[1]).mkdir()
    adatracker_deploy.app.trial_run.run_trial = short_trial
    real = ("--platform", "wheeled", "--camera", "world://simple_room", "--trials", "3")
    sys.exit(main([*real, "--log-dir", sys.argv[1]]))
