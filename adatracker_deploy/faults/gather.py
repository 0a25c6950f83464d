"""Gathers a row's evidence: the command's exit status and output, the trial's log, the monitored
processes."""

from __future__ import annotations

import contextlib
import json
import os
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.faults.evidence import INTERRUPTED_STATUS, Evidence, Tick
from adatracker_deploy.trial.reader import find_trials, read_trial

if TYPE_CHECKING:
    import subprocess
    from pathlib import Path

    from adatracker_deploy.faults.matrix import Row
    from adatracker_deploy.faults.process_monitor import ProcessMonitor
    from adatracker_deploy.sim.ground_truth import Account

_LONGEST = 200
"""Longest reason, characters."""


def said(done: subprocess.CompletedProcess[str]) -> str:
    """Return the last line that a run printed."""
    lines = done.stderr.strip().splitlines()
    if any("Traceback" in line for line in lines):
        return f"Traceback: {lines[-1]}"
    words = [line for line in lines if line.startswith("adatracker-deploy: ")]
    return " ".join((words or lines or [f"exit {done.returncode}"])[-1].split())[-_LONGEST:]


def gather(
    row: Row, done: subprocess.CompletedProcess[str], watch: ProcessMonitor, folder: Path, account: Account
) -> Evidence:
    """Return a run's evidence.

    Args:
        row: the row that was run.
        done: the finished command.
        watch: the monitor of its processes.
        folder: for the trials' logs; created by a run that got that far.
        account: its robot's ground-truth record.
    """
    summary: dict[str, Any] = {}
    with contextlib.suppress(IndexError, ValueError):
        summary = json.loads(done.stdout.strip().splitlines()[-1])
        summary = summary.get("trials", [summary])[0]
    evidence = Evidence(
        account=account,
        seen=watch.seen(),
        cores=len(os.sched_getaffinity(0)),
        status=done.returncode,
        outcome=summary.get("outcome", "interrupted" if done.returncode == INTERRUPTED_STATUS else ""),
        reason=summary.get("reason", said(done)),
        log_trouble="the log is incomplete" in done.stderr,
    )
    if not folder.is_dir():
        return evidence  # it ended before it had a log
    try:
        logged = read_trial(min(path if path.is_dir() else path.parent for path in find_trials(folder)))
    except (UsageError, ValueError):
        return evidence  # the same
    onset_ns = account.onset_ns(row.fault) or 0
    # The run's clock is the machine's, except in a simulated suspend; the log's events have wall-clock times.
    events = [(event.wall_ns - (logged.wall_offset_ns or 0), event) for event in logged.events]
    later = [(t_ns, event) for t_ns, event in events if t_ns > onset_ns]
    stops = [pair for pair in later if pair[1].message.startswith(("holding: ", "disengaging: "))]
    ends = [pair for pair in later if pair[1].message.startswith(_OUTCOMES)]
    first = min((*stops[:1], *ends[:1]), key=lambda pair: pair[0], default=None)
    return replace(
        evidence,
        latched_s=(stops[0][0] - onset_ns) / 1e9 if stops and onset_ns else None,
        noticed=_noticed(row, first[1].message if first else "", first[1].level if first else ""),
        ticks=tuple(Tick(step.t_ns, step.frame_seq, step.action) for step in logged.steps),
        log_whole=logged.complete,
    )


_OUTCOMES = ("completed", "lost", "collision", "safety_stop", "takeover", "system_fault", "interrupted")


def _noticed(row: Row, message: str, level: str) -> str:
    """Return who noticed first: a link's stop that nobody requested is a warning. Pure."""
    if row.fault in {"tracker_kill", "tracker_stop"}:
        return "link"
    if row.fault in {"link_kill", "link_stop"}:
        return "robot"
    if not message:
        return ""
    return "tracker" if message.startswith(_OUTCOMES) else "link" if level == "warning" else "tracker"
