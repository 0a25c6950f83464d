"""A simulator as an engineer starts it in a shell: its module, without a trial around it."""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import sys
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Simulator:
    process: subprocess.Popen
    ready: dict[str, Any]
    """What it announced."""


@contextlib.contextmanager
def simulator_by_hand(module, *arguments):
    """Start a simulator's module; give it once it is up, and kill it at the end, also when it is halted."""
    with subprocess.Popen(
        [sys.executable, "-m", module, *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            line = process.stdout.readline()
            assert line.startswith('{"ready"'), line
            yield Simulator(process, json.loads(line)["ready"])
        finally:
            process.send_signal(signal.SIGCONT)
            process.kill()
