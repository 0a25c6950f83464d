"""Faults of this process and the link's: signals, CPU starvation, a stalled interpreter, a suspend.

Faults that stop the tracker are run by a small separate process, which goes on meanwhile.
"""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import subprocess
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from adatracker_deploy.core.faults import Fault

HOGS = 4
PAUSE_S = 0.1
"""Length of the interpreter stall; a full collection of 600,000 objects takes 0.08 s."""
_SLEEP = """
import os, signal, sys, time
from adatracker_deploy.core import pause
path, lasts_s, *pids = sys.argv[1:]
for pid in map(int, pids):
    os.kill(pid, signal.SIGSTOP)
began_ns = time.monotonic_ns()
time.sleep(float(lasts_s))
pause.add(path, time.monotonic_ns() - began_ns)
for pid in map(int, pids):
    os.kill(pid, signal.SIGCONT)
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Victims:
    """The current targets of faults; 0 or None for those that do not exist."""

    link: int = 0
    robot: int = 0
    """The simulated robot's process."""
    log_writer: int = 0
    log_part: Path | None = None
    """The log file being written."""
    pause: str = ""
    """The shared pause of the run's clock."""


def _signal(pid: int, number: signal.Signals) -> None:
    if pid:
        os.kill(pid, number)


def _stop_tracker(_: Victims, fault: Fault) -> None:
    me = os.getpid()
    subprocess.Popen(["/bin/sh", "-c", f"kill -STOP {me}; sleep {fault.lasts_s:g}; kill -CONT {me}"]).wait()


def _suspend(victims: Victims, fault: Fault) -> None:
    """Stop the link and this process; their shared clock stands still until they continue."""
    pids = [str(pid) for pid in (victims.link, os.getpid()) if pid]
    subprocess.Popen([sys.executable, "-c", _SLEEP, victims.pause, str(fault.lasts_s), *pids]).wait()


def _hog(_victims: Victims, fault: Fault) -> None:
    burn = f"import time\nend = time.monotonic() + {fault.lasts_s:g}\nwhile time.monotonic() < end: pass"
    for _ in range(HOGS):
        subprocess.Popen([sys.executable, "-c", burn])


def _pause(_: Victims, __: Fault) -> None:
    """Hold the GIL, as a full collection does, but for a known time on any machine."""
    ctypes.PyDLL(None).usleep(round(PAUSE_S * 1e6))


def _fill_disk(victims: Victims, _: Fault) -> None:
    if victims.log_part is None:
        return
    full_bytes = victims.log_part.stat().st_size
    resource.prlimit(victims.log_writer, resource.RLIMIT_FSIZE, (full_bytes, full_bytes))


STRIKES: dict[str, Callable[[Victims, Fault], None]] = {
    "tracker_stop": _stop_tracker,
    "tracker_kill": lambda _, __: os.kill(os.getpid(), signal.SIGKILL),
    "link_stop": lambda victims, _: _signal(victims.link, signal.SIGSTOP),
    "link_kill": lambda victims, _: _signal(victims.link, signal.SIGKILL),
    "robot_frozen": lambda victims, _: _signal(victims.robot, signal.SIGSTOP),
    "interrupt": lambda _, __: os.kill(os.getpid(), signal.SIGINT),
    "terminate": lambda _, __: os.kill(os.getpid(), signal.SIGTERM),
    "hangup": lambda _, __: os.kill(os.getpid(), signal.SIGHUP),
    "suspend": _suspend,
    "cpu_hogs": _hog,
    "gc_pause": _pause,
    "disk_full": _fill_disk,
}
"""The functions that inject each fault, by name."""
MENDS: dict[str, Callable[[Victims], None]] = {
    "link_stop": lambda victims: _signal(victims.link, signal.SIGCONT),
    "robot_frozen": lambda victims: _signal(victims.robot, signal.SIGCONT),
}
"""The functions that end faults which do not end by themselves."""
