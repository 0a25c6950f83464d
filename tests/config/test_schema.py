"""Settings are typed, bounded and complete, or refused with the place and the reason."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.config.schema import Range, parse
from adatracker_deploy.core.errors import UsageError


@dataclass(frozen=True)
class Inner:
    gain: Annotated[float, Range(0, 1)]


@dataclass(frozen=True, kw_only=True)
class Settings:
    name: str
    count: int = 3
    on: bool = True
    mode: Literal["fast", "slow"] = "fast"
    inner: Inner | None = None
    points: tuple[float, ...] = ()
    pair: tuple[int, int] = (0, 0)
    limit: Annotated[float, Range(0, 10)] | None = None
    extra: dict[str, int] | None = None
    colour: Literal["random"] | tuple[int, ...] = "random"


def test_a_whole_mapping_becomes_the_dataclass():
    made = parse(
        Settings,
        {
            "name": "a",
            "inner": {"gain": 1},
            "points": [1, 2.5],
            "pair": [1, 2],
            "limit": 3,
            "extra": {"k": 1},
            "colour": [1, 2, 3],
        },
        where="f",
    )
    assert made == Settings(
        name="a",
        inner=Inner(1.0),
        points=(1.0, 2.5),
        pair=(1, 2),
        limit=3.0,
        extra={"k": 1},
        colour=(1, 2, 3),
    )


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ({}, "f: missing key 'name'"),
        ({"name": "a", "coutn": 1}, "f: unknown key 'coutn'; did you mean 'count'"),
        ({"name": "a", "zzz": 1}, "known keys are name, count"),
        ({"name": 3}, "f: name: expected text, got int 3"),
        ({"name": "a", "count": 1.5}, "f: count: expected a whole number"),
        ({"name": "a", "count": True}, "f: count: expected a whole number"),
        ({"name": "a", "on": 1}, "f: on: expected true or false"),
        ({"name": "a", "mode": "medium"}, "f: mode: expected one of 'fast', 'slow'"),
        ({"name": "a", "inner": {"gain": 1.01}}, r"f: inner: gain: 1.01 is out of range \[0, 1\]"),
        ({"name": "a", "inner": 5}, "f: inner: expected a mapping"),
        ({"name": "a", "limit": 11}, "f: limit: 11.0 is out of range"),
        ({"name": "a", "pair": [1]}, "f: pair: expected 2 values, got 1"),
        ({"name": "a", "points": ["x"]}, r"f: points\[0\]: expected a number"),
        ({"name": "a", "points": [math.nan]}, "expected a finite number"),
        ({"name": "a", "extra": {1: 2}}, "f: extra: expected a mapping with text keys"),
        ({"name": "a", "colour": "red"}, "f: colour: expected one of 'random', .*; or expected a list"),
        ({"name": ["x" * 9] * 10**6}, r"f: name: expected text, got list .{,100}$"),
        ([], "f: expected a mapping, got list"),
        (None, "f: expected a mapping, got nothing"),
    ],
)
def test_what_is_wrong_is_named(document, message):
    with pytest.raises(UsageError, match=message):
        parse(Settings, document, where="f")


anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(st.sampled_from(["name", "count", "on", "mode", "inner", "points", "pair"]), anything))
def test_any_document_is_either_read_or_refused_in_one_line(document):
    try:
        made = parse(Settings, document, where="f")
    except UsageError as error:
        assert len(str(error).splitlines()) == 1  # noqa: PT017 -- either outcome is right
    else:
        assert isinstance(made, Settings)
        assert made.inner is None or 0 <= made.inner.gain <= 1
