"""Two tiers of one suite: what every run tests, and what a run with ``--exhaustive`` adds, as every night.

A pytest plugin, which `conftest` loads. Every run has each claim at least once. The night repeats it with the
other robots, moments, seeds and signals (`EXHAUSTIVE`, on a test or a parameter), with Hypothesis' every
example (`examples`), and races 50 times (the fixture `exhaustive`).
"""

from __future__ import annotations

import pytest

EXHAUSTIVE = pytest.mark.exhaustive
"""Marks a repeat: another test, or another parameter of the same one, shows the same on each run."""

_nightly = False


def pytest_addoption(parser):
    parser.addoption(
        "--exhaustive",
        action="store_true",
        help="repeat what everyday runs sample: every race 50 times, every moment of a takeover, every robot",
    )


def pytest_configure(config):
    global _nightly  # noqa: PLW0603 -- decorators of test modules ask for it as they are imported
    _nightly = bool(config.getoption("--exhaustive"))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    if config.getoption("--exhaustive"):
        return
    repeats = [item for item in items if item.get_closest_marker("exhaustive")]
    config.hook.pytest_deselected(items=repeats)
    items[:] = [item for item in items if not item.get_closest_marker("exhaustive")]


@pytest.fixture
def exhaustive(request) -> bool:
    """Whether to repeat in full what everyday runs sample."""
    return bool(request.config.getoption("--exhaustive"))


def examples(everyday: int, *, of: int) -> int:
    """Return how many examples Hypothesis draws: some on each run, all `of` them every night."""
    return of if _nightly else everyday
