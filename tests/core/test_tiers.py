"""What only the nightly run has runs there alone, and pytest counts each one left out."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

pytest_plugins = ["pytester"]

ROOT = Path(__file__).parents[2]

SUITE = """
    import pytest
    from hypothesis import given, settings, strategies
    from tests.tiers import EXHAUSTIVE, examples, sampled

    drawn = []

    @pytest.mark.parametrize("robot", sampled(("base", "drone"), everyday=("base",)))
    def test_a_claim(robot):
        pass

    @pytest.mark.parametrize(("a", "b"), sampled(((1, 2), (3, 4)), everyday=((3, 4),)))
    def test_two_names(a, b):
        assert b == a + 1

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
    ("arguments", "ran"), [((), {"passed": 4, "deselected": 3}), (("--exhaustive",), {"passed": 7})]
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
