"""The hand takes over by the dead-man button, stands when it is let go, and gives back only when told to."""

from __future__ import annotations

from functools import reduce

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.runtime.teleop.takeover import AXES, CODES, HandState, InputEvent, after, begun, wish

S = 1_000_000_000


def told(*events, alone=False):
    """Return the state after events (seconds, code, value), from the first tick of a trial."""
    state = begun(HandState(alone=alone))
    return reduce(after, (InputEvent(round(t_s * S), *event) for t_s, *event in events), state)


def drives(state, t_s=9.0):
    return wish(state, round(t_s * S)).drives


def moves(state, t_s=9.0):
    """Return whether the hand asks for anything but zero."""
    asked = wish(state, round(t_s * S))
    assert asked.values == () or asked.held_until_ns is None or asked.held_until_ns > t_s * S
    return asked.values != ()


PRESS, RELEASE, BACK = (1, "dead_man", 1.0), (2, "dead_man", 0.0), (3, "give_back")


def test_the_policy_drives_until_the_button_is_pressed_whatever_the_sticks_say():
    assert not drives(told((0, "forward", 1.0), (1, "yaw", -0.5)))
    state = told((0, "forward", 1.0), PRESS)
    assert drives(state)
    assert wish(state, 9 * S).values == (1.0, 0.0, 0.0, 0.0)


def test_a_released_button_is_zero_at_that_tick_and_the_hand_still_drives():
    state = told((0, "forward", 1.0), PRESS, RELEASE)
    asked = wish(state, 9 * S)
    assert (asked.drives, asked.values, asked.held_until_ns) == (True, (), 9 * S)


def test_only_an_explicit_act_gives_back_and_not_while_the_button_is_held():
    assert not drives(told(PRESS, RELEASE, BACK))
    assert drives(told(PRESS, BACK))
    assert drives(told(PRESS, BACK, (4, "dead_man", 0.0)))  # the act does not wait for the release
    assert drives(told(PRESS, RELEASE, BACK, (4, "dead_man", 1.0)))


def test_a_key_counts_as_held_for_so_long_and_not_a_nanosecond_longer():
    state = told((1, "forward", 0.5), (1, "dead_man_s", 0.15))
    assert moves(state, 1.149999999)
    assert wish(state, S).held_until_ns == 1_150_000_000  # which the gate is told: no tick need come
    assert drives(state, 1.15)
    assert not moves(state, 1.15)
    assert drives(told((1, "dead_man_s", 0.15), (1.1, "give_back")))
    assert not drives(told((1, "dead_man_s", 0.15), (1.2, "give_back")))


def test_taking_over_without_a_button_stands_still():
    state = told((0, "forward", 1.0), (1, "take"))
    assert drives(state)
    assert not moves(state)


@pytest.mark.parametrize("before", [(), (PRESS,), (PRESS, RELEASE), (PRESS, RELEASE, BACK)])
def test_a_lost_device_is_a_released_button_for_good_and_never_gives_back(before):
    state = told(*before, (4, "gone"), (5, "give_back"), (6, "dead_man", 1.0), (7, "dead_man_s", 1.0))
    assert drives(state)
    assert not moves(state, 7.5)


def test_alone_there_is_nobody_to_give_back_to():
    assert drives(told(alone=True))
    assert drives(told(PRESS, RELEASE, BACK, alone=True))
    assert not moves(told(alone=True))


def test_a_button_that_was_down_before_the_first_tick_must_be_pressed_anew():
    state = begun(after(after(HandState(), InputEvent(-S, "forward", 1.0)), InputEvent(-S, "dead_man", 1.0)))
    assert not drives(state)
    assert wish(after(state, InputEvent(1, "dead_man", 1.0)), S).values == (1.0, 0.0, 0.0, 0.0)
    assert drives(begun(after(HandState(), InputEvent(-S, "gone"))))


EVENTS = st.lists(st.tuples(st.integers(0, 10 * S), st.sampled_from(CODES), st.floats(-1, 1)), max_size=30)


@given(EVENTS, st.booleans(), st.integers(0, 12 * S))
def test_nothing_moves_unless_the_button_was_pressed_or_a_key_repeated_since_its_release(events, alone, t_ns):
    """Check it without the state machine: look back in the events for what last held the button."""
    history = [InputEvent(at, code, abs(x) if code not in AXES else x) for at, code, x in sorted(events)]
    asked = wish(reduce(after, history, begun(HandState(alone=alone))), t_ns)
    if asked.values:
        assert not any(event.code == "gone" for event in history)
        ends = [
            n for n, e in enumerate(history) if e.code == "take" or (e.code == "dead_man" and e.value == 0)
        ]
        since = history[ends[-1] + 1 :] if ends else history
        pressed = any(event.code == "dead_man" for event in since)
        key = any(event.code == "dead_man_s" and event.t_ns + event.value * S > t_ns - 1 for event in since)
        assert pressed or key
