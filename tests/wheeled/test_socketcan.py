"""SocketCAN itself: the wheeled base on a real ``vcan0``, in this kernel or in a user-mode one.

Each test here runs one file of cases in there; ``docs/socketcan.md`` tells how to run them by hand.
"""

from __future__ import annotations

import sys

import pytest

from tests.tiers import EXHAUSTIVE
from tests.wheeled.uml.choice import NoRoomError, find_room

CASES = "tests/wheeled/uml"


@pytest.fixture(scope="module")
def room():
    try:
        return find_room()
    except NoRoomError as reason:
        pytest.skip(str(reason))


def pass_in(room, cases: str, limit_s: float) -> None:
    ended = room(
        [sys.executable, "-m", "pytest", "-n", "0", "-p", "no:cacheprovider", f"{CASES}/{cases}"],
        limit_s=limit_s,
    )
    assert ended.status == 0, ended.output


@EXHAUSTIVE
def test_python_cans_socketcan_interface_behaves_as_the_adapter_relies_on(room):
    pass_in(room, "cases_interface.py", limit_s=90.0)


@EXHAUSTIVE
def test_the_wheeled_bus_says_what_ended_it_and_stays_ended(room):
    pass_in(room, "cases_bus.py", limit_s=90.0)


@EXHAUSTIVE
@pytest.mark.slow
def test_a_base_on_a_real_bus_is_driven_and_comes_to_rest_when_the_bus_or_the_process_stops(room):
    pass_in(room, "cases_wheeled.py", limit_s=120.0)
