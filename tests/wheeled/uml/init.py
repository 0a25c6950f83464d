"""The first process of the user-mode kernel: makes ``vcan0``, runs one command, tells its end, powers off.

The root is the host's file system, read-only. What the guest writes is in memory (``/run``, ``/dev/shm``) and
goes with it; only the command's output and its exit status leave, by one serial line each.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import subprocess
import sys
import termios
import traceback
from pathlib import Path

from tests.wheeled.uml.interfaces import add_vcan, set_up
from tests.wheeled.uml.room import TIMED_OUT

OUTPUT, STATUS = "/dev/ttyS0", "/dev/ttyS1"
MODULES = (
    "net/can/can",
    "net/can/can-raw",
    "net/can/can-bcm",
    "drivers/net/can/dev/can-dev",
    "drivers/net/can/vcan",
)
"""In the order of their dependencies."""
MOUNTS = (("proc", "/proc"), ("sysfs", "/sys"), ("tmpfs", "/run"), ("tmpfs", "/dev/shm"))
SYS_FINIT_MODULE = 313
"""On x86-64, the only machine that user-mode Linux is packaged for; glibc has no wrapper."""
POWER_OFF = 0x4321FEDC
"""LINUX_REBOOT_CMD_POWER_OFF of reboot(2)."""

_libc = ctypes.CDLL(None, use_errno=True)


def main(job_file: str) -> None:
    """Run the job that the launcher wrote: command, working folder, environment and time limit."""
    try:
        _furnish()
        job = json.loads(Path(job_file).read_text())
        status = _run(job["command"], job["cwd"], job["environment"], job["limit_s"])
        _write_line(STATUS, str(status))
    except BaseException:  # whatever it is, the first process must not end: the kernel would panic
        traceback.print_exc()
    os.sync()
    _libc.reboot(POWER_OFF)


def _furnish() -> None:
    for kind, place in MOUNTS:
        Path(place).mkdir(exist_ok=True)
        _check(_libc.mount(kind.encode(), place.encode(), kind.encode(), 0, None), place)
    tree = Path("/usr/lib/uml/modules", os.uname().release, "kernel")
    for module in MODULES:
        with (tree / f"{module}.ko").open("rb") as file:
            _check(_libc.syscall(SYS_FINIT_MODULE, file.fileno(), b"", 0), module)
    add_vcan("vcan0")
    set_up("vcan0")
    set_up("lo")


def _run(command: list[str], cwd: str, environment: dict[str, str], limit_s: float) -> int:
    """Return the command's exit status as a shell tells it; orphans are reaped on the way."""

    def expire(*_: object) -> None:
        raise TimeoutError

    with Path(OUTPUT).open("wb", buffering=0) as output:
        mode = termios.tcgetattr(output)
        mode[1] &= ~termios.OPOST  # a line's end stays one byte
        termios.tcsetattr(output, termios.TCSANOW, mode)
        child = subprocess.Popen(
            command, cwd=cwd, env=environment, stdin=subprocess.DEVNULL, stdout=output, stderr=output
        )
        signal.signal(signal.SIGALRM, expire)
        signal.setitimer(signal.ITIMER_REAL, limit_s)
        pid = ended = 0
        try:
            while pid != child.pid:
                pid, ended = os.wait()
        except TimeoutError:
            return TIMED_OUT
        finally:
            termios.tcdrain(output)
    code = os.waitstatus_to_exitcode(ended)
    return code if code >= 0 else 128 - code


def _write_line(device: str, text: str) -> None:
    with Path(device).open("wb", buffering=0) as line:
        line.write(text.encode())
        termios.tcdrain(line)


def _check(result: int, what: str) -> None:
    if result:
        error = ctypes.get_errno()
        raise OSError(error, os.strerror(error), what)


if __name__ == "__main__":
    main(sys.argv[1])
