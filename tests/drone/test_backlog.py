"""MAVSDK's backlog stays bounded; tested in exact time."""

from hypothesis import given
from hypothesis import strategies as st

from adatracker_drone.adapter.backlog import MOST_BEHIND, PATIENCE_S, Backlog


def begun():
    backlog = Backlog()
    backlog.begin(0.0)
    return backlog


def test_before_anybody_is_told_everything_is_taken():
    backlog = Backlog()
    assert all(backlog.takes(1, 0.0) for _ in range(100))
    backlog.begin(1.0)
    assert backlog.takes(1, 1.0), "what came before does not count"


def test_one_that_tells_takes_for_ever():
    backlog = begun()
    for number in range(1000):
        assert backlog.takes(1, number / 5)
        assert all(backlog.takes(0, number / 5) for _ in range(50))
        backlog.tell(number / 5 + 0.1)


def test_one_that_is_behind_takes_nothing_until_it_has_caught_up():
    backlog = begun()
    assert sum(backlog.takes(1, 0.1) for _ in range(1000)) == MOST_BEHIND + 1
    assert not backlog.takes(0, 0.1)
    backlog.tell(0.2)
    assert backlog.takes(0, 0.2)
    assert backlog.takes(1, 0.2)
    assert not backlog.takes(0, 0.2)


def test_in_a_fast_rehearsal_as_many_seconds_may_be_on_their_way():
    backlog = Backlog(speed=5.0)
    backlog.begin(0.0)
    assert sum(backlog.takes(1, 0.1) for _ in range(1000)) == 5 * MOST_BEHIND + 1


def test_heartbeats_that_are_never_told_of_block_the_rest_only_for_a_while():
    backlog = begun()
    while backlog.takes(1, 0.1):
        pass
    assert not backlog.takes(0, PATIENCE_S - 0.01)
    assert backlog.takes(0, PATIENCE_S)
    assert backlog.takes(1, PATIENCE_S)


@given(st.lists(st.tuples(st.booleans(), st.floats(0, 1))))
def test_whatever_happens_no_more_than_a_few_are_on_their_way(history):
    backlog, on_their_way, now_s, told_s = begun(), 0, 0.0, 0.0
    for hands, later_s in history:
        now_s += later_s
        if hands and now_s - told_s < PATIENCE_S:
            on_their_way += backlog.takes(1, now_s)
        elif on_their_way:
            backlog.tell(now_s)
            on_their_way, told_s = on_their_way - 1, now_s
        assert on_their_way <= MOST_BEHIND + 1
