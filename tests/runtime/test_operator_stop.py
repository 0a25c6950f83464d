"""Every stop request is remembered; it interrupts a trial once, and never the trial's ending."""

from __future__ import annotations

import os
import signal

import pytest

from adatracker_deploy.runtime.operator_stop import SIGNALS, StopRequest

EACH = pytest.mark.parametrize("number", SIGNALS, ids=lambda number: number.name)


def ask(number=signal.SIGINT):
    os.kill(os.getpid(), number)


@EACH
def test_a_request_interrupts_a_trial_once(number):
    told = []
    stop = StopRequest(lambda: told.append("stopping"))
    with stop.listening(), stop.trial():
        with pytest.raises(KeyboardInterrupt):
            ask(number)
        ask(number)  # while the robot is brought to rest
        with stop.finishing():
            ask(number)
        ask(number)  # while the link is closed
    assert stop.asked
    assert told == ["stopping"]


@EACH
def test_a_request_while_a_trial_ends_is_remembered_after_it(number):
    stop = StopRequest()
    with stop.listening():
        with stop.trial(), stop.finishing():
            ask(number)
        assert stop.asked
        with pytest.raises(KeyboardInterrupt):  # at a question, where nothing has to be brought to rest
            ask(number)
        with pytest.raises(KeyboardInterrupt):
            ask(number)


def test_a_trial_on_its_own_ends_undisturbed_and_leaves_the_signals_as_they_were():
    before = [signal.getsignal(number) for number in SIGNALS]
    stop = StopRequest()
    with stop.finishing():
        ask()
    assert stop.asked
    assert [signal.getsignal(number) for number in SIGNALS] == before


def test_a_run_that_outlives_its_terminal_is_stopped_by_everything_else():
    stop = StopRequest(outlives_terminal=True)
    with stop.listening(), stop.trial():
        ask(signal.SIGHUP)
        assert not stop.asked
        with pytest.raises(KeyboardInterrupt):
            ask(signal.SIGTERM)
    assert stop.asked


def test_a_hangup_that_was_ignored_is_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        stop = StopRequest()
        with stop.listening():
            ask(signal.SIGHUP)
        assert not stop.asked
    finally:
        signal.signal(signal.SIGHUP, before)
