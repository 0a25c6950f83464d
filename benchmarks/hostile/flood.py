"""A flood of packets, what it costs, and whether everything lives on."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.platform import Platform

WARM_UP = 1000
BATCH = 200
"""Packets between two looks at whether the other side keeps up."""
PATIENCE_S = 20.0


@dataclass(frozen=True)
class Result:
    seconds: float
    grown_kb: int
    ignored: str
    """The reaction of the side under attack."""
    faults: tuple[str, ...]
    """Things that should not have happened."""


def memory_kb(pid: int | str = "self") -> int:
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS"))


def until(condition: Callable[[], object], patience_s: float = PATIENCE_S) -> bool:
    """Wait for a condition; return whether it came."""
    pause, end_s = threading.Event(), time.monotonic() + patience_s
    while not condition():
        if time.monotonic() > end_s:
            return False
        pause.wait(0.002)
    return True


def pour(
    packets: Iterator, count: int, send: Callable, keeps_up: Callable[[int], object], pid: int | str = "self"
) -> tuple[float, int]:
    """Send `count` packets, and before them those of the warm-up; return seconds and kB grown."""
    sent = 0

    def some(wanted: int) -> None:
        nonlocal sent
        for packet in itertools.islice(packets, wanted):
            send(packet)
            sent += 1
            if sent % BATCH == 0:
                keeps_up(sent)

    some(min(WARM_UP, count))
    before_kb, begun_s = memory_kb(pid), time.monotonic()
    some(count - min(WARM_UP, count))
    return time.monotonic() - begun_s, memory_kb(pid) - before_kb


def lives(platform: Platform) -> Iterator[str]:
    """Yield what does not work any more: hearing the robot, the preflight, engaging and disengaging."""
    asked_ns = platform.clock.now_ns()
    if not until(lambda: platform.state().t_ns > asked_ns):
        yield "the robot is not heard any more"
        return
    if platform.state().engaged or platform.state().stopped:
        yield f"it engaged, or stopped: {platform.state().stopped}"

    def unfit() -> list[str]:
        return [check.message for check in platform.preflight() if check.blocking and not check.ok]

    if not until(lambda: not unfit()):
        yield f"the preflight fails: {unfit()}"
        return
    refusals: list[str] = []

    def engages() -> bool:
        """Try; a state that the flood faked stands until the robot's own next one."""
        try:
            platform.engage()
            platform.disengage()
        except PlatformError as error:
            refusals.append(str(error))
            return False
        return True

    if not until(engages):
        yield refusals[-1]
