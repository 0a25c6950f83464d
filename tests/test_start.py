"""The command is there at once: whatever is heavy is imported by the subcommand that needs it."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

HEAVY = ("numpy", "cv2", "onnx", "onnxruntime", "google.protobuf", "mcap", "rich", "msgspec", "torch")
CPU_S = 0.4
LOOKS = f"""
import sys
from adatracker_deploy.cli import main
try:
    main(sys.argv[1:])
finally:
    print(*(name for name in {HEAVY} if name in sys.modules), file=sys.stderr)
"""


@pytest.mark.parametrize("arguments", [("--version",), ("--help",), ("stop", "nobody")])
def test_nothing_heavy_is_imported_to_say_what_it_can_do_or_to_stop_a_robot(arguments):
    done = subprocess.run(
        [sys.executable, "-c", LOOKS, *arguments], capture_output=True, text=True, check=False
    )
    assert done.stderr.splitlines()[-1] == ""


def test_it_starts_within_four_tenths_of_a_second_of_the_processor(measured):
    """The least of three starts, interpreter and all: others take nothing of it."""
    times = []
    for _ in range(3):
        process = subprocess.Popen(
            [sys.executable, "-m", "adatracker_deploy", "--version"], stdout=subprocess.DEVNULL
        )
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        assert process.returncode == 0
        times.append(used.ru_utime + used.ru_stime)
    measured(f"the command is imported and answers --version in {min(times):.2f} s of processor time")
    assert min(times) < CPU_S
