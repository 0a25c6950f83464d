"""What all tests share: figures that are shown after the run, and who may run beside whom.

Tests run in two processes (``-n 2 --dist loadgroup``): the slow flights in one, the slow ground robots in the
other, each with its share of the rest, so that no more than two robots share two cores.
"""

from __future__ import annotations

from pathlib import Path

import hypothesis
import pytest

hypothesis.settings.register_profile("busy", deadline=None)  # the machine is shared: time is no verdict
hypothesis.settings.register_profile("brief", deadline=None, max_examples=20, derandomize=True, database=None)
hypothesis.settings.load_profile("busy")

TESTS = Path(__file__).parent
GROUPS = {
    "flights": ("drone", "e2e/test_faults.py", "e2e/test_operator", "e2e/test_rehearsal.py", "test_doctor"),
    "ground": ("e2e/test_dry_run.py", "e2e/test_field", "e2e/test_ground", "outside", "quadruped", "wheeled"),
}
MEASURED = "measured"


@pytest.fixture
def measured(record_property):
    """Give a function that has a line shown after the run, whatever process the test ran in."""

    def show(line: str) -> None:
        record_property(MEASURED, line)

    return show


@pytest.hookimpl(tryfirst=True)  # before xdist reads the groups
def pytest_collection_modifyitems(items):
    for item in items:
        path = item.path.relative_to(TESTS).as_posix() if item.path.is_relative_to(TESTS) else ""
        for group, places in GROUPS.items():
            if path.startswith(places) and item.get_closest_marker("slow"):
                item.add_marker(pytest.mark.xdist_group(group))


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
