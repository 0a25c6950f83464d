"""Two tiers of one suite: what every run tests, and what a run with ``--exhaustive`` adds, as every night.

A pytest plugin, which `conftest` loads. Every run shows a claim where that is cheapest: in one process, at
one robot's simulator, or by a row of the fault matrix's sample. The night shows it again with the other
robots, moments, seeds and signals, and has alone what takes long: whole rehearsals, long flights, a kernel in
a process (`EXHAUSTIVE`, on a test; `sampled`, of a test's parameters). It also draws more examples
(`examples`, and Hypothesis' profile) and runs races 50 times (the fixture `exhaustive`).
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import hypothesis
import pytest

if TYPE_CHECKING:
    from collections.abc import Container, Iterable

EXHAUSTIVE = pytest.mark.exhaustive
"""Marks what the night alone runs: a repeat of what each run shows at less cost, or what takes long."""

_nightly = False
for _name, _number in (("everyday", 40), ("night", 100)):
    hypothesis.settings.register_profile(
        _name,
        max_examples=_number,
        deadline=None,  # on a busy machine time is no verdict
        derandomize=bool(os.environ.get("CI")),  # so that a change is judged by what it changes
    )


def pytest_addoption(parser):
    parser.addoption(
        "--exhaustive",
        action="store_true",
        help="repeat what everyday runs sample: every race 50 times, every moment of a takeover, every robot",
    )


def pytest_configure(config):
    global _nightly  # noqa: PLW0603 -- decorators of test modules ask for it as they are imported
    _nightly = bool(config.getoption("--exhaustive"))
    if not config.getoption("--hypothesis-profile", None):
        hypothesis.settings.load_profile("night" if _nightly else "everyday")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    if config.getoption("--exhaustive"):
        return
    repeats = [item for item in items if item.get_closest_marker("exhaustive")]
    config.hook.pytest_deselected(items=repeats)
    items[:] = [item for item in items if not item.get_closest_marker("exhaustive")]


def sampled(values: Iterable[Any], *, everyday: Container[Any]) -> list[Any]:
    """Return a test's parameters, of which each run has those of `everyday`; a tuple is of several names."""
    return [
        value
        if value in everyday
        else pytest.param(*(value if isinstance(value, tuple) else (value,)), marks=EXHAUSTIVE)
        for value in values
    ]


@pytest.fixture
def exhaustive(request) -> bool:
    """Whether to repeat in full what everyday runs sample."""
    return bool(request.config.getoption("--exhaustive"))


def examples(everyday: int, *, of: int) -> int:
    """Return how many examples Hypothesis draws: some on each run, all `of` them every night."""
    return of if _nightly else everyday
