"""Real-time priority and cores for the threads that keep time: asked for, given, read back from the kernel.

Linux gives both to a thread, and what a thread starts inherits them. The loop's thread takes them while it
loops. The link takes them before it connects, so that its adapter's threads, which carry the same commands,
have them too.

The loop's thread alone would gain little: it needs the interpreter's lock, and whoever holds that at an
ordinary priority is kept from running by any busy process, and the loop with it. So the tracker's other
Python threads (perception, the camera's reader) come before ordinary processes as well, behind the loop. A
network's own threads, which never hold the lock, stay ordinary, and so does the log's writer.

A core that has nothing to do sleeps, and takes its time to wake: on bare metal up to a fraction of a
millisecond, on a virtual machine as long as its host likes, which was 10 ms and more. Real-time priority is
of no use to who has not been woken, so cores are kept awake as well, where the system allows that.
"""

from __future__ import annotations

import contextlib
import os
import re
import struct
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from collections.abc import Set as AbstractSet

LINK_PRIORITY = 45
LOOP_PRIORITY = 40
BESIDE_PRIORITY = 20
"""Of SCHED_FIFO, 1 to 99: the link, the loop, and what shares its interpreter. Interrupts have 50."""
MEND = "a line `USER - rtprio 50` in /etc/security/limits.d/rt.conf, then log in again"
"""How a user is allowed real-time priority."""
LATENCY_FILE = Path("/dev/cpu_dma_latency")
"""Whoever holds it open says how long any core may take to wake, in microseconds, a 32-bit integer
(docs.kernel.org/power/pm_qos_interface.html)."""
MEND_AWAKE = f'KERNEL=="{LATENCY_FILE.name}", GROUP="realtime", MODE="0660" in a file in /etc/udev/rules.d'
"""How a group of users is allowed to keep cores awake."""

_POLICIES = {os.SCHED_OTHER: "ordinary priority", os.SCHED_FIFO: "SCHED_FIFO", os.SCHED_RR: "SCHED_RR"}
_PART = re.compile(r"(\d{1,5})(?:-(\d{1,5}))?", re.ASCII)


@dataclass(frozen=True, slots=True)
class Scheduling:
    """What the threads that keep time are to be given."""

    realtime: bool = False
    """SCHED_FIFO, at the priorities above."""
    cpus: frozenset[int] = frozenset()
    """The only cores that they may use; empty: any."""

    def __bool__(self) -> bool:
        return self.realtime or bool(self.cpus)

    def check(self) -> None:
        """See that it can be had, by having it for a moment.

        Raises:
            UsageError: the system refuses it.
        """
        with _kept(0):
            self.take(LINK_PRIORITY)

    @contextlib.contextmanager
    def awake(self) -> Iterator[bool]:
        """Keep the machine's cores awake in real time, where that is allowed; give whether they are."""
        with contextlib.ExitStack() as stack:
            held = False
            with contextlib.suppress(OSError):
                if self.realtime:
                    file = stack.enter_context(LATENCY_FILE.open("wb", buffering=0))
                    held = file.write(struct.pack("=i", 0)) > 0
            yield held

    @contextlib.contextmanager
    def while_looping(self) -> Iterator[None]:
        """Have it in the calling thread, and priority in those beside it; give it back at the end.

        Raises:
            UsageError: as `check`.
        """
        with contextlib.ExitStack() as stack:
            stack.enter_context(_kept(0))
            self.take(LOOP_PRIORITY)
            for thread in threading.enumerate() if self.realtime else ():
                if thread is not threading.current_thread() and thread.native_id is not None:
                    stack.enter_context(_kept(thread.native_id))
                    with contextlib.suppress(ProcessLookupError):  # it has just ended
                        os.sched_setscheduler(
                            thread.native_id, os.SCHED_FIFO, os.sched_param(BESIDE_PRIORITY)
                        )
            yield

    def take(self, priority: int) -> None:
        """Have it for good, in the calling thread and what it starts from now on.

        Raises:
            UsageError: as `check`.
        """
        if self.cpus:
            try:
                os.sched_setaffinity(0, self.cpus)
            except OSError as error:
                raise UsageError(f"--cpu {cpus_text(self.cpus)}: refused ({error.strerror})") from error
        if self.realtime:
            try:
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
            except OSError as error:
                raise UsageError(
                    f"--realtime: the system refuses it ({error.strerror}); to allow it: {MEND}"
                ) from error


ORDINARY = Scheduling()


@contextlib.contextmanager
def _kept(thread: int) -> Iterator[None]:
    """Give a thread back what it has now, whatever it was given meanwhile; 0 is the calling one."""
    had = None
    with contextlib.suppress(ProcessLookupError):
        had = os.sched_getscheduler(thread), os.sched_getparam(thread), os.sched_getaffinity(thread)
    try:
        yield
    finally:
        if had is not None:
            policy, param, cpus = had
            with contextlib.suppress(ProcessLookupError):
                if (os.sched_getscheduler(thread), os.sched_getparam(thread)) != (policy, param):
                    os.sched_setscheduler(thread, policy, param)
                if os.sched_getaffinity(thread) != cpus:
                    os.sched_setaffinity(thread, cpus)


def obtained(pid: int = 0) -> str:
    """Say what a process's first thread, or with 0 the calling one, really has, as the kernel tells it."""
    policy = os.sched_getscheduler(pid) & ~os.SCHED_RESET_ON_FORK
    told = _POLICIES.get(policy, f"scheduling policy {policy}")
    if priority := os.sched_getparam(pid).sched_priority:
        told += f" {priority}"
    return f"{told} on cores {cpus_text(os.sched_getaffinity(pid))}"


def read_cpus(text: str, usable: AbstractSet[int]) -> frozenset[int]:
    """Read a list of cores as ``taskset -c`` takes it: ``2``, ``0,2-3``.

    Args:
        text: the list.
        usable: the cores that this process may use.

    Raises:
        UsageError: it is no list, or names a core that is not usable.
    """
    cpus: set[int] = set()
    for part in text.split(","):
        match = _PART.fullmatch(part)
        if match is None or int(match[1]) > int(match[2] or match[1]):
            raise UsageError(f"--cpu {text}: {part!r} is neither a core nor a range of cores, as in 0,2-3")
        cpus.update(range(int(match[1]), int(match[2] or match[1]) + 1))
    if missing := cpus - usable:
        raise UsageError(f"--cpu {text}: core {min(missing)} cannot be used; there are {cpus_text(usable)}")
    return frozenset(cpus)


def cpus_text(cpus: AbstractSet[int]) -> str:
    """Write a set of cores as `read_cpus` reads it."""
    parts: list[str] = []
    for cpu in sorted(cpus):
        if cpu - 1 not in cpus:
            parts.append(f"{cpu}")
        elif cpu + 1 not in cpus:
            parts[-1] += f"-{cpu}"
    return ",".join(parts)
