"""Run a command under user-mode Linux: a second kernel, with ``vcan0``, in an ordinary process.

Needs Debian's package ``user-mode-linux`` (``linux.uml`` and its modules); neither root nor a network.
"""

from __future__ import annotations

import contextlib
import functools
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from tests.wheeled.uml.room import ROOT, Ended

if TYPE_CHECKING:
    from collections.abc import Sequence

JOB = "job.json"
MEMORY_MB = 512
BOOT_LIMIT_S = 30.0
"""To boot and to power off; 2 s on an idle machine."""

GUEST = {"HOME": "/run", "TMPDIR": "/run", "TERM": "dumb", "PYTHONDONTWRITEBYTECODE": "1"}
"""What is different in there: only ``/run`` can be written to, and output goes to a plain serial line."""


class BootError(Exception):
    """The kernel ended, or was ended, before the command had."""


def kernel() -> str | None:
    """Return the path of the user-mode kernel, or None where it is not installed or cannot run."""
    program = shutil.which("linux.uml") if Path("/usr/lib/uml/modules").is_dir() else None
    return program if program is not None and _runs(program) else None


@functools.cache
def _runs(program: str) -> bool:
    """Tell whether the kernel can run a program on this processor.

    Linux 6.1 keeps too little room for the registers of some (those with AMX): its first program ends in
    ``ptrace set fp regs failed, errno = 14``.
    """
    try:
        return _run(program, ["true"], limit_s=20.0).status == 0
    except BootError as error:
        return "ptrace set fp regs failed" not in str(error)


def run(command: Sequence[str], *, limit_s: float) -> Ended:
    """Run `command` as root of a kernel of its own, where ``vcan0`` and ``lo`` are up.

    It has one processor, this file system read-only and this process's environment, save that ``HOME`` and
    ``TMPDIR`` are in the guest's memory. Nothing is left behind, in whatever way this ends.

    Raises:
        BootError: the kernel did not come up or go down; tells what it said last.
    """
    program = kernel()
    if program is None:
        raise BootError(
            "user-mode Linux is not installed (apt-get install user-mode-linux), or cannot run here"
        )
    return _run(program, command, limit_s=limit_s)


def _run(program: str, command: Sequence[str], *, limit_s: float) -> Ended:
    with tempfile.TemporaryDirectory(prefix="uml-") as folder:
        job = {"command": command, "cwd": str(ROOT), "environment": os.environ | GUEST, "limit_s": limit_s}
        Path(folder, JOB).write_text(json.dumps(job))
        status, status_line = os.pipe()
        with os.fdopen(status, "rb") as status_file:
            process = subprocess.Popen(
                [program, *_kernel_arguments(folder, status_line)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                pass_fds=[status_line],
                cwd=folder,
                env=os.environ | {"TMPDIR": _memory_folder(folder)},
                start_new_session=True,  # the kernel is several processes, ended as one group
            )
            os.close(status_line)
            try:
                output, said = process.communicate(timeout=limit_s + BOOT_LIMIT_S)
            except subprocess.TimeoutExpired:
                _end(process)
                output, said = process.communicate()
            finally:
                _end(process)
            told = status_file.read()
    if not told:
        raise BootError(f"the user-mode kernel ended before its command had; it said:\n{_text(said)[-2000:]}")
    return Ended(int(told), _text(output))


def _kernel_arguments(folder: str, status_line: int) -> list[str]:
    """Return the kernel's command line; what the kernel does not know it gives to the first process."""
    return [
        *(f"mem={MEMORY_MB}M", f"uml_dir={folder}", "umid=guest", "quiet"),
        *("root=/dev/root", "rootfstype=hostfs", "rootflags=/", "ro"),
        *("con0=null,fd:2", "con=null", "ssl0=null,fd:1", f"ssl1=null,fd:{status_line}", "ssl=null"),
        *(f'"PYTHONPATH={ROOT}"', "PYTHONDONTWRITEBYTECODE=1"),
        *(f'"init={sys.executable}"', "--", "-m", "tests.wheeled.uml.init", f'"{folder}/{JOB}"'),
    ]


def _memory_folder(folder: str) -> str:
    """Return where the guest's memory is a file: in memory, unless there is little, as in a container."""
    shared = Path("/dev/shm")
    roomy = shared.is_dir() and shutil.disk_usage(shared).free > 2 * MEMORY_MB << 20
    return str(shared) if roomy else folder


def _end(process: subprocess.Popen[bytes]) -> None:
    with contextlib.suppress(ProcessLookupError):  # the group can outlive its first process
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _text(output: bytes) -> str:
    return output.decode(errors="replace")
