"""Real-time priority and cores for the time-critical threads: requested, set, and read back from the kernel.

On Linux both belong to a thread and are inherited by threads it starts. The loop's thread takes them while it
loops. The link takes them before it connects, so that its adapter's threads have them too.

Priority for the loop's thread alone would help little: a normal-priority thread that holds the GIL can be
preempted by any busy process while the loop waits for it (priority inversion). So the tracker's other Python
threads (perception, camera reader) get real-time priority too, below the loop's. Inference threads, which
never hold the GIL, keep normal priority, and so does the log's writer.

An idle core sleeps and needs time to wake: on bare metal a fraction of a millisecond, on a virtual machine as
long as its host takes (10 ms and more were measured). Real-time priority does not help a sleeping core, so
cores are kept awake as well, where the system allows it.
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
"""SCHED_FIFO priorities, 1 to 99: the link, the loop, and the threads that share its interpreter. Interrupts
have 50."""
MEND = "a line `USER - rtprio 50` in /etc/security/limits.d/rt.conf, then log in again"
"""Instructions for allowing a user real-time priority."""
LATENCY_FILE = Path("/dev/cpu_dma_latency")
"""While held open, sets the longest wake-up time of any core, in microseconds, as a 32-bit integer
(docs.kernel.org/power/pm_qos_interface.html)."""
MEND_AWAKE_RULE = f'KERNEL=="{LATENCY_FILE.name}", GROUP="realtime", MODE="0660"'
MEND_AWAKE = f"{MEND_AWAKE_RULE} in a file in /etc/udev/rules.d"
"""Instructions for allowing a group of users to keep cores awake."""

_POLICIES = {os.SCHED_OTHER: "ordinary priority", os.SCHED_FIFO: "SCHED_FIFO", os.SCHED_RR: "SCHED_RR"}
_PART = re.compile(r"(\d{1,5})(?:-(\d{1,5}))?", re.ASCII)


@dataclass(frozen=True, slots=True)
class Scheduling:
    """Requested scheduling of the time-critical threads."""

    realtime: bool = False
    """Use SCHED_FIFO, at the priorities above."""
    cpus: frozenset[int] = frozenset()
    """The cores that they may use; empty for any."""

    def __bool__(self) -> bool:
        return self.realtime or bool(self.cpus)

    def check(self) -> None:
        """Check that it can be had, by setting it briefly.

        Raises:
            UsageError: the system refuses it.
        """
        with _kept(0):
            self.take(LINK_PRIORITY)

    @contextlib.contextmanager
    def awake(self) -> Iterator[bool]:
        """Keep the machine's cores awake if real-time is requested and allowed; yield whether they are."""
        with contextlib.ExitStack() as stack:
            held = False
            with contextlib.suppress(OSError):
                if self.realtime:
                    file = stack.enter_context(LATENCY_FILE.open("wb", buffering=0))
                    held = file.write(struct.pack("=i", 0)) > 0
            yield held

    @contextlib.contextmanager
    def while_looping(self) -> Iterator[None]:
        """Set it in the calling thread, and priority in its sibling threads; restore both at the end.

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
        """Set it permanently, in the calling thread and in threads it starts from now on.

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
    """Restore a thread's current scheduling on exit; 0 is the calling thread."""
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
    """Describe the actual scheduling of a process's first thread (0: the calling thread), as the kernel
    reports it."""
    policy = os.sched_getscheduler(pid) & ~os.SCHED_RESET_ON_FORK
    told = _POLICIES.get(policy, f"scheduling policy {policy}")
    if priority := os.sched_getparam(pid).sched_priority:
        told += f" {priority}"
    return f"{told} on cores {cpus_text(os.sched_getaffinity(pid))}"


def read_cpus(text: str, usable: AbstractSet[int]) -> frozenset[int]:
    """Parse a list of cores as for ``taskset -c``: ``2``, ``0,2-3``.

    Args:
        text: the list.
        usable: the cores that this process may use.

    Raises:
        UsageError: it is not a list, or names an unusable core.
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
    """Format a set of cores for `read_cpus`."""
    parts: list[str] = []
    for cpu in sorted(cpus):
        if cpu - 1 not in cpus:
            parts.append(f"{cpu}")
        elif cpu + 1 not in cpus:
            parts[-1] += f"-{cpu}"
    return ",".join(parts)
