"""Runs one row of the matrix: the real command in its own processes, and the evidence that it leaves."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import yaml

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.faults.gather import gather, said
from adatracker_deploy.faults.judge import LANDED_M, STILL_M_S, Result, judge, limit_of
from adatracker_deploy.faults.phases import TrialPhase
from adatracker_deploy.faults.process_monitor import ProcessMonitor
from adatracker_deploy.faults.running_simulator import serving
from adatracker_deploy.platform import Scenario
from adatracker_deploy.registry import load_platform, load_profile, profile_dir
from adatracker_deploy.sim.ground_truth import Account, read_witness

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from typing import Any

    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.faults.matrix import Row
    from adatracker_deploy.faults.stalls import StallMonitor
    from adatracker_deploy.platform import Platform

COMMAND = (sys.executable, "-m", "adatracker_deploy")
GOES_ON_S = 4.0
"""Time for which a trial goes on after a fault that should not stop it."""
FEW_STEPS_S = 2.0
"""Duration of a trial whose fault comes before it follows, or as it ends at full speed."""
SEED = 3
WIDTH_PX = 160
"""Width of the pictures, of which only the truth is used."""
TIMEOUT_S = 120.0
"""Time-out for a whole row, including a drone's take-off and landing."""
REST_S = 30.0
"""Time-out for a robot to come to rest after its tracker was killed."""
RESTED_S = 0.3
"""A robot that has stood this long has come to rest."""
POLL_S = 0.05
STALL_BEFORE_S, STALL_AFTER_S = 0.3, 1.0
"""Window around the onset in which a stall of the machine could look like a late stop."""
_AGAIN = ("--steps", "3", "--fault", f"interrupt@{TrialPhase.LOOKING}")
"""A second run shows that the robot can be engaged again; the person may have walked away by then."""


def rehearse(row: Row, platform_name: str, says: str, stalls: StallMonitor, folder: Path) -> Result:
    """Run one row in `folder`, which is empty, and judge it.

    Args:
        row: the row to run.
        platform_name: the robot's.
        says: what happens, in words for people.
        stalls: monitors the machine meanwhile.
        folder: for the trial's log.
    """
    try:
        return _rehearse(row, platform_name, says, stalls, folder)
    except PlatformError as error:  # the simulator did not start: other rows may still run
        return Result(
            platform=platform_name,
            fault=row.fault,
            phase=row.phase,
            variant=row.variant,
            says=says,
            limit=limit_of(row, platform_name),
            verdict="WRONG",
            note=str(error),
        )


def _rehearse(row: Row, platform_name: str, says: str, stalls: StallMonitor, folder: Path) -> Result:
    platform, flies = load_platform(platform_name), "vz" in load_platform(platform_name).axes
    profile_arguments, profile = _profile(platform, row.changes, folder)
    began_ns, again = time.monotonic_ns(), ""
    with serving(platform, profile, Scenario(seed=SEED, width_px=WIDTH_PX), folder) as (simulator, witness):
        common = (
            *("--platform", platform_name, "--sitl", "--simulator", str(simulator), *profile_arguments),
            *("--seed", str(SEED), "--segmenter", "truth", "--json", "--log-dir", str(folder / "trials")),
        )
        process = _start(*common, *_struck(row))
        with ProcessMonitor(process.pid, witness) as watch:
            done = _finish(process)
            ended_ns = time.monotonic_ns()
            _await_rest(watch, witness, flies=flies, lands=row.lands)
        evidence = gather(row, done, watch, folder / "trials", read_witness(witness.read_text()))
        if row.again:
            again = _second_run(_finish(_start(*common, *_AGAIN)), witness, since_ns=ended_ns)
        if not row.lands:
            _switch_off(evidence.account)  # it hovers, and would do so for a minute
    evidence = replace(evidence, account=replace(evidence.account, off=read_witness(witness.read_text()).off))
    onset_ns = evidence.account.onset_ns(row.fault)
    if onset_ns is not None:
        evidence = replace(evidence, exit_s=(ended_ns - onset_ns) / 1e9)
    accel_m_s2 = profile.limits.accel_m_s2
    result = judge(row, platform_name, says, evidence, flies=flies, accel_m_s2=accel_m_s2)
    result = replace(result, again=again)
    if "Traceback" in again and result.verdict == "ok":
        result = replace(result, verdict="WRONG", note=f"a second run failed: {again}")
    until_ns = (onset_ns or time.monotonic_ns()) + round(
        (STALL_AFTER_S + min(result.told_s or 0.0, 2.0)) * 1e9
    )
    since_ns = began_ns if onset_ns is None else onset_ns - round(STALL_BEFORE_S * 1e9)
    return replace(result, stall_s=stalls.largest_s(since_ns, until_ns))


def run_command(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the toolkit's own command to its end; the exit status is -1 if it had to be killed."""
    return _finish(_start(*arguments))


def _start(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*COMMAND, *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def _finish(process: subprocess.Popen[str]) -> subprocess.CompletedProcess[str]:
    try:
        out, err = process.communicate(timeout=TIMEOUT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return subprocess.CompletedProcess(process.args, -1, "", f"did not end within {TIMEOUT_S:g} s")
    return subprocess.CompletedProcess(process.args, process.returncode, out, err)


def _struck(row: Row) -> tuple[str, ...]:
    """Return the arguments that request the row's fault."""
    following = row.phase is TrialPhase.FOLLOWING
    seconds = row.after_s + GOES_ON_S if following else FEW_STEPS_S
    when = f"{row.after_s:g}" if following else f"{row.phase}+{row.after_s:g}"
    return (
        *("--fault", f"{row.fault}@{when}", "--steps", str(round(seconds * _rate_hz()))),
        *("--trials", str(row.trials)),
    )


def _profile(
    platform: type[Platform], changes: Mapping[str, Mapping[str, Any]] | None, folder: Path
) -> tuple[tuple[str, ...], Profile]:
    """Return the argument that names the row's profile, and the profile with its own port."""
    arguments: tuple[str, ...] = ()
    name = platform.default_profile
    if changes:
        document = yaml.safe_load(((platform.profile_dir or profile_dir()) / f"{name}.yaml").read_text())
        for section, values in changes.items():
            document.setdefault(section, {}).update(values)
        path = folder / "profile.yaml"
        path.write_text(yaml.safe_dump(document))
        arguments, name = ("--profile", str(path)), str(path)
    profile = load_profile(name, platform)
    url = getattr(
        profile.connection, "url", ""
    )  # a UDP port; the other robots' simulators take free ones anyway
    if url.startswith("udpin://127.0.0.1:"):
        profile = replace(profile, connection=replace(profile.connection, url="udpin://127.0.0.1:0"))
    return arguments, profile


def _await_rest(watch: ProcessMonitor, witness: Path, *, flies: bool, lands: bool) -> None:
    """Wait, `REST_S` at most, until the robot stands and nobody commands it any more."""
    end_s = time.monotonic() + REST_S
    while time.monotonic() < end_s:
        account = read_witness(witness.read_text())
        if not watch.link_lives and _rests(account, flies=flies, lands=lands):
            return
        time.sleep(POLL_S)


def _rests(account: Account, *, flies: bool, lands: bool) -> bool:
    """Return whether a robot has come to rest, and stood for a moment. Pure."""
    if not account.speeds:
        return False
    since_ns = account.speeds[-1][0] - round(RESTED_S * 1e9)
    still = all(speed <= STILL_M_S[flies] for t_ns, speed in account.speeds if t_ns >= since_ns)
    landed = not account.flight or account.flight[-1].height_m <= LANDED_M
    disarmed = not account.modes or not account.modes[-1][2]
    return still and (not lands or (landed and disarmed))


def _switch_off(account: Account) -> None:
    robot = account.process("robot")
    if robot is not None:
        with contextlib.suppress(ProcessLookupError):
            os.kill(robot, signal.SIGKILL)


def _second_run(done: subprocess.CompletedProcess[str], witness: Path, since_ns: int) -> str:
    """Return what a second run did with the robot as the first left it."""
    account = read_witness(witness.read_text())
    if any(t_ns > since_ns for t_ns, phase in account.phases if phase == TrialPhase.LOOKING):
        return "engages again"
    return f"refuses: {said(done)}"


def _rate_hz() -> float:
    from adatracker_deploy.policy.catalogue import DEFAULT, load_policy

    return load_policy(DEFAULT).info.rate_hz
