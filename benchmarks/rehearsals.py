"""Shared by the benchmarks of whole trials: a plan for one, and the processes that it started."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

from adatracker_deploy.app.trial_plan import TrialPlan
from adatracker_deploy.perception.segmenters import TRUTH, open_segmenter
from adatracker_deploy.perception.target.choice import Choice
from adatracker_deploy.platform import Scenario
from adatracker_deploy.policy.catalogue import load_policy
from adatracker_deploy.registry import load_platform, load_profile
from adatracker_deploy.runtime.scheduling import ORDINARY, Scheduling

POLICY = "pid"
"""Runs at 20 Hz."""
NAMES = {
    "adatracker-link": "link",
    "trial.writer": "log",
    "_wheeled": "robot",
    "_drone": "robot",
    "_quadruped": "robot",
}
"""Names of a trial's processes, by a part of their command."""


def rehearsal(
    platform: str,
    log_dir: Path,
    steps: int,
    *,
    seed: int = 0,
    target_speed_m_s: float = 1.0,
    scheduling: Scheduling = ORDINARY,
) -> TrialPlan:
    """Plan what ``adatracker-deploy --platform NAME --sitl --policy pid`` runs."""
    robot = load_platform(platform)
    profile = load_profile(robot.default_profile, robot)
    segmenter, segmenter_name = open_segmenter(
        TRUTH, "person", Choice.read("largest"), rate_hz=profile.camera.rate_hz
    )
    return TrialPlan(
        platform=robot,
        profile=profile,
        policy=load_policy(POLICY),
        scenario=Scenario(seed=seed, target_speed_m_s=target_speed_m_s),
        camera="",
        segmenter=segmenter,
        segmenter_name=segmenter_name,
        sitl=True,
        dry_run=False,
        steps=steps,
        speed=1.0,
        log_dir=log_dir,
        scheduling=scheduling,
    )


@contextlib.contextmanager
def cpu_hogs(count: int, rest_ms: float = 0.0):
    """Keep so many processes busy with nothing, all but the first `rest_ms` of every 100 ms.

    A machine that is lent by quota is taken away for what is left of its period, up to 100 ms, when all its
    cores were busy all the time; no priority inside it helps.
    """
    rest_s = rest_ms / 1e3
    work = f"if time.monotonic() % 0.1 < {rest_s}: time.sleep({rest_s})" if rest_ms else "pass"
    hogs = [
        subprocess.Popen([sys.executable, "-c", f"import time\nwhile True:\n  {work}"]) for _ in range(count)
    ]
    try:
        yield
    finally:
        for hog in hogs:
            hog.kill()
            hog.wait()


def children(pid: int) -> list[int]:
    """Return the ids of a process's children, of all its threads."""
    found: list[int] = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        with contextlib.suppress(FileNotFoundError):
            found += map(int, (task / "children").read_text().split())
    return found


def name_of(pid):
    """Say which of a trial's processes it is."""
    words = Path(f"/proc/{pid}/comm").read_text() + Path(f"/proc/{pid}/cmdline").read_text()
    return next((name for mark, name in NAMES.items() if mark in words), "helper")


def family(pid):
    """Return the processes below one, with their names; those of one name are numbered."""
    found, count = {}, Counter()
    for child in children(pid):
        with contextlib.suppress(FileNotFoundError):
            name = name_of(child)
            count[name] += 1
            found[child] = name if count[name] == 1 else f"{name} {count[name]}"
            found |= {pid: f"{found[child]}'s {name}" for pid, name in family(child).items()}
    return found


def favour_robot():
    """Let this process's simulated robot go before others, where the system allows it.

    It stands for a machine of its own, which no other process could keep from running.
    """
    for pid, name in family(os.getpid()).items():
        if name.startswith("robot"):
            for task in Path(f"/proc/{pid}/task").iterdir():
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    os.setpriority(os.PRIO_PROCESS, int(task.name), -18)


def machine() -> str:
    """Say in a line on what this ran."""
    load = ", ".join(f"{value:.1f}" for value in os.getloadavg())
    return f"{len(os.sched_getaffinity(0))} cores, load {load}"
