"""Runs start together, or not at all when who started them is gone."""

from __future__ import annotations

import threading

import pytest

from adatracker_deploy.runtime.start_line import StartLine, StartLineKeeper


@pytest.fixture
def ends():
    keeper = StartLineKeeper()
    line = StartLine(keeper.theirs.detach())
    yield keeper, line
    keeper.close()


def test_a_stage_is_told_and_waited_for(ends):
    keeper, line = ends
    assert keeper.reached() == 0
    for stage in (1, 2):
        line.reach()
        assert not line.open()
        assert keeper.reached() == stage
        assert keeper.reached() == stage
        keeper.release()
        assert line.open()
        assert not line.open()


def test_who_waits_goes_on_when_released(ends):
    keeper, line = ends
    keeper.release()
    line.wait()
    assert keeper.reached() == 1


def test_who_waits_is_interrupted_when_the_other_end_is_gone(ends):
    keeper, line = ends
    threading.Timer(0.05, keeper.close).start()
    with pytest.raises(KeyboardInterrupt):
        line.wait()
