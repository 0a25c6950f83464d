"""What all tests share: figures that are shown after the run, and robots that drive in real time.

Tests run in two processes, a file at a time (``-n 2 --dist loadfile``). Files that drive robots for long come
late, so that two cores then have two robots at most and nothing else, and whole rehearsals come last, one at
a time (`alone`). Before a file of real-time tests what earlier ones left is collected, once; and a real-time
test that failed while the machine itself stood still is run again (`reruns`), which is shown after the run
and counted. What only repeats a claim is left to the night (`tiers`).
"""

from __future__ import annotations

from pathlib import Path

import hypothesis
import pytest

pytest_plugins = ["tests.alone", "tests.reruns", "tests.tiers"]

hypothesis.settings.register_profile("brief", deadline=None, max_examples=20, derandomize=True, database=None)
TESTS = Path(__file__).parent
REAL_TIME = (
    "drone",
    "e2e",
    "faults",
    "outside",
    "perception",
    "quadruped",
    "ros2",
    "runtime",
    "test_doctor",
    "trial",
    "wheeled",
)
MEASURED = "measured"


@pytest.fixture
def measured(record_property):
    """Give a function that has a line shown after the run, whatever process the test ran in."""

    def show(line: str) -> None:
        record_property(MEASURED, line)

    return show


def pytest_collection_modifyitems(items):
    from tests.alone import is_alone  # not before pytest has loaded that plugin and rewritten its asserts

    late = set()
    for item in items:
        path = item.path.relative_to(TESTS).as_posix() if item.path.is_relative_to(TESTS) else ""
        if path.startswith(REAL_TIME):
            item.add_marker("realtime")
            if item.get_closest_marker("slow"):
                late.add(item.path)
    items.sort(key=lambda item: (is_alone(item.path), item.path in late))


def pytest_terminal_summary(terminalreporter):
    reports = [report for kind in ("passed", "failed") for report in terminalreporter.getreports(kind)]
    lines = [
        line
        for report in reports
        for name, line in getattr(report, "user_properties", ())
        if name == MEASURED
    ]
    if lines:
        terminalreporter.section(MEASURED)
        for line in sorted(lines):
            terminalreporter.line(line)
