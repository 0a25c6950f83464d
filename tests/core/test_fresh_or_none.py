"""A measurement that falls silent is no measurement, in the machine's time."""

from __future__ import annotations

import pytest

from adatracker_deploy.core.clock import FakeClock
from adatracker_deploy.core.stamps import fresh_or_none


@pytest.mark.parametrize("speed", [1.0, 5.0])
def test_what_was_told_lately_counts_and_nothing_older(speed):
    clock = FakeClock(speed=speed)
    told_ns = clock.now_ns()
    clock.advance(1.9 * speed)
    assert fresh_or_none(0.5, told_ns, clock, 2.0) == 0.5
    clock.advance(0.2 * speed)
    assert fresh_or_none(0.5, told_ns, clock, 2.0) is None
    assert fresh_or_none(None, 0, clock, 2.0) is None
