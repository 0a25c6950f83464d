"""Another library's error goes into a sentence of ours as one short line, whatever it holds."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.errors import line_of

TRACEBACK = 'Traceback (most recent call last):\n  File "bus.py", line 1\nConnectionResetError'


@given(st.text(), st.integers(20, 400))
def test_it_is_one_short_line_with_something_in_it(text, most):
    line = line_of(RuntimeError(text), most)
    assert 0 < len(line) <= most
    assert line.splitlines() == [line]
    assert line == line.strip()


def test_its_text_is_kept_without_line_breaks_and_the_last_stop():
    assert line_of(RuntimeError("no such device\n  (-113).\n")) == "no such device (-113)"


def test_a_traceback_in_it_is_cut_off():
    assert line_of(RuntimeError(f"the bus has gone: {TRACEBACK}")) == "the bus has gone:"
    assert line_of(ValueError(TRACEBACK)) == "ValueError"


def test_the_systems_own_words_are_told_without_their_number_and_with_the_file():
    assert (
        line_of(OSError(28, "No space left on device", "/trials/1")) == "/trials/1: No space left on device"
    )
    assert line_of(ConnectionResetError(104, "Connection reset by peer")) == "Connection reset by peer"
    assert line_of(KeyError()) == "KeyError"
