"""A recording of a hand's events comes back to the bit, and what is none is refused by its line."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.runtime.teleop.event_file import read_events, write_events
from adatracker_deploy.runtime.teleop.takeover import AXES, CODES, InputEvent

LONGEST_NS = 10**15
VALUES = {True: st.floats(-1, 1), False: st.floats(0, 1)}
EVENTS = st.sampled_from(CODES).flatmap(
    lambda code: st.builds(
        InputEvent, st.integers(-LONGEST_NS, LONGEST_NS), st.just(code), VALUES[code in AXES]
    )
)


@given(st.lists(EVENTS, max_size=20))
def test_what_is_written_is_read_to_the_bit(tmp_path_factory, events):
    path = tmp_path_factory.mktemp("hand") / "teleop.jsonl"
    events = sorted(events, key=lambda event: event.t_ns)
    path.write_text(write_events(events))
    assert repr(read_events(path)) == repr(tuple(events))  # repr: -0.0 is not 0.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"t_s": 0, "code": "fly"}', "unknown code 'fly': there are dead_man,"),
        ('{"t_s": 0, "code": "forward", "value": 1.5}', "value 1.5: expected a number from -1 to 1"),
        ('{"t_s": 0, "code": "forward", "value": NaN}', "value nan"),
        ('{"t_s": Infinity, "code": "stop"}', "t_s inf"),
        ('{"t_s": 0, "code": "dead_man", "value": -1}', "none below 0"),
        ('{"t_s": 0, "code": ["stop"]}', "unknown code"),
        ('{"t_s": true, "code": "stop"}', "t_s True"),
        ('{"code": "stop"}', 'expected {"t_s": SECONDS'),
        ('{"t_s": 0, "code": "stop", "when": 1}', 'expected {"t_s": SECONDS'),
        ("stop", "line 2: Expecting value"),
        ('{"t_s": -1, "code": "stop"}', "line 2: its time is before"),
        ("[" * 100_000, "line 2"),
    ],
)
def test_what_is_no_event_is_refused_with_its_line(tmp_path, text, words):
    path = tmp_path / "hand.jsonl"
    path.write_text('{"t_s": 0, "code": "take"}\n' + text)
    with pytest.raises(UsageError) as told:
        read_events(path)
    assert f"{path}: line 2: " in str(told.value)
    assert words in str(told.value)


def test_a_file_that_is_not_there_or_not_text_is_refused(tmp_path):
    with pytest.raises(UsageError, match="cannot be read"):
        read_events(tmp_path / "none.jsonl")
    (tmp_path / "noise").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(UsageError, match="line 1"):
        read_events(tmp_path / "noise")
