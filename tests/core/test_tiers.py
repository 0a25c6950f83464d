"""Tests that only repeat a claim run in the nightly run alone, and pytest counts each one left out."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

pytest_plugins = ["pytester"]

ROOT = Path(__file__).parents[2]

SUITE = """
    import pytest
    from hypothesis import given, settings, strategies
    from tests.tiers import EXHAUSTIVE, examples

    drawn = []

    @pytest.mark.parametrize("robot", ["base", pytest.param("drone", marks=EXHAUSTIVE)])
    def test_a_claim(robot):
        pass

    @EXHAUSTIVE
    def test_a_repeat():
        pass

    @settings(max_examples=examples(3, of=9), database=None)
    @given(strategies.integers())
    def test_examples(number):
        drawn.append(number)

    def test_so_many_were_drawn(exhaustive):
        assert len(drawn) == (9 if exhaustive else 3)
"""


@pytest.mark.parametrize(
    ("arguments", "ran"), [((), {"passed": 3, "deselected": 2}), (("--exhaustive",), {"passed": 5})]
)
def test_a_run_has_each_claim_and_the_night_its_repeats(pytester, monkeypatch, arguments, ran):
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    pytester.makeini("[pytest]\nmarkers = exhaustive: repeats a claim")
    pytester.makepyfile(SUITE)
    result = pytester.runpytest_subprocess(
        "-p", "no:cacheprovider", "--strict-markers", "-p", "tests.tiers", *arguments
    )
    result.assert_outcomes(**ran)
