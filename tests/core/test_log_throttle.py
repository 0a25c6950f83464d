"""A repeated event is logged at each power of ten of its count."""

from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.log_throttle import worth_logging


def test_of_ten_thousand_the_powers_of_ten_are_told():
    assert [count for count in range(10_001) if worth_logging(count - 1, count)] == [
        1,
        10,
        100,
        1_000,
        10_000,
    ]


@given(st.integers(0, 10**9), st.integers(0, 10**9))
def test_whatever_is_skipped_a_new_power_of_ten_is_told_once(told, count):
    assert worth_logging(told, count) == (len(str(told or "")) < len(str(count or "")) and count > told)
