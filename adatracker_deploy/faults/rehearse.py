"""Runs one row of the matrix: the real command in processes of its own, and the evidence that it leaves."""

from __future__ import annotations

import contextlib
import itertools
import json
import subprocess
import sys
import time
from dataclasses import replace
from typing import TYPE_CHECKING

from adatracker_deploy.errors import UsageError
from adatracker_deploy.faults.judge import Evidence, Result, judge
from adatracker_deploy.faults.witness import FILE_NAME, Account, read_witness
from adatracker_deploy.platform import load_platform
from adatracker_deploy.profile import load_profile
from adatracker_deploy.trial.reader import find_trials, read_trial

if TYPE_CHECKING:
    from pathlib import Path

    from adatracker_deploy.faults.matrix import Row
    from adatracker_deploy.faults.stalls import Stalls

COMMAND = (sys.executable, "-m", "adatracker_deploy")
AT_S = 3.0
"""When a fault begins: the person walks, and the robot has come up to speed."""
GOES_ON_S = 4.0
"""How long a trial goes on after a fault that should not stop it."""
SEED = 3
TIMEOUT_S = 120.0
"""For a whole row, a drone's take-off and landing with it."""
REST_S = 30.0
"""For a robot whose tracker was killed to come to rest, and its far end to say so."""
POLL_S = 0.05
STALL_BEFORE_S, STALL_AFTER_S = 0.3, 1.0
"""About the onset: where a stall of the machine's could be taken for a late stop."""


def rehearse(row: Row, platform_name: str, says: str, stalls: Stalls, folder: Path) -> Result:
    """Run one row in `folder`, which is empty, and judge it.

    Args:
        row: what to show.
        platform_name: of the robot.
        says: what happens, for people.
        stalls: watches the machine meanwhile.
        folder: for the trial's log.
    """
    platform = load_platform(platform_name)
    profile = load_profile(platform.default_profile, platform)
    steps = round((AT_S + GOES_ON_S) * _rate_hz())
    began_ns = time.monotonic_ns()
    done = run_command(
        *("--platform", platform_name, "--sitl", "--fault", f"{row.fault}@{AT_S:g}", "--steps", str(steps)),
        *("--seed", str(SEED), "--segmenter", "truth", "--json", "--log-dir", str(folder)),
    )
    ended_ns = time.monotonic_ns()
    evidence = _evidence(row, done, folder)
    struck_ns = evidence.account.onset_ns(row.fault)
    if struck_ns is not None:
        evidence = replace(evidence, exit_s=(ended_ns - struck_ns) / 1e9)
    result = judge(
        row,
        platform_name,
        says,
        evidence,
        flies="vz" in platform.axes,
        accel_m_s2=profile.limits.accel_m_s2,
    )
    onset_ns = evidence.account.onset_ns(row.fault)
    until_ns = (onset_ns or time.monotonic_ns()) + round(
        (STALL_AFTER_S + min(result.told_s or 0.0, 2.0)) * 1e9
    )
    since_ns = began_ns if onset_ns is None else onset_ns - round(STALL_BEFORE_S * 1e9)
    return replace(result, stall_s=stalls.largest_s(since_ns, until_ns))


def run_command(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the toolkit's own command to its end; -1 is the exit status of one that had to be killed."""
    try:
        return subprocess.run(
            [*COMMAND, *arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(arguments, -1, "", f"did not end within {TIMEOUT_S:g} s")


def _evidence(row: Row, done: subprocess.CompletedProcess[str], folder: Path) -> Evidence:
    summary = {}
    with contextlib.suppress(IndexError, ValueError):
        summary = json.loads(done.stdout.strip().splitlines()[-1])
    try:
        (trial,) = {path if path.is_dir() else path.parent for path in find_trials(folder)}
    except (UsageError, ValueError):
        reason = " ".join(done.stderr.split())[-200:]
        return Evidence(account=Account(), status=done.returncode, outcome="", reason=reason)
    account = _account(trial / FILE_NAME)
    logged = read_trial(trial)
    begins = [
        event.wall_ns for event in logged.events if event.message.startswith(f"fault: {row.fault} begins")
    ]
    stops = [
        event.wall_ns
        for event in logged.events
        if event.message.startswith(("holding: ", "disengaging: ")) and event.wall_ns > min(begins, default=0)
    ]
    onset_ns = account.onset_ns(row.fault)
    ticks = [step.t_ns for step in logged.steps if onset_ns is not None and step.t_ns > onset_ns]
    return Evidence(
        account=account,
        status=done.returncode,
        outcome=summary.get("outcome", ""),
        reason=summary.get("reason", ""),
        latched_s=(min(stops) - begins[0]) / 1e9 if stops and begins else None,
        tick_gaps_s=tuple((b - a) / 1e9 for a, b in itertools.pairwise(ticks)),
        log_trouble="the log is not whole" in done.stderr,
        log_whole=logged.complete,
    )


def _account(path: Path) -> Account:
    """Return what the witness wrote, once its robot is at rest."""
    end_s = time.monotonic() + REST_S
    while True:
        account = read_witness(path.read_text()) if path.exists() else Account()
        if account.off or time.monotonic() > end_s:
            return account
        time.sleep(POLL_S)


def _rate_hz() -> float:
    from adatracker_deploy.policy.catalogue import DEFAULT, load_policy

    return load_policy(DEFAULT).info.rate_hz
