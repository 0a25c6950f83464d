"""Among people who walk about, the gate keeps a robot from driving into whom its camera shows."""

from __future__ import annotations

import pytest

from benchmarks.crowd import LIMITS, WITHOUT, touched_s


@pytest.mark.parametrize("seed", [8, 25, 27, 39])
def test_who_comes_towards_the_robot_in_full_view_is_not_driven_into(seed):
    assert touched_s(seed, WITHOUT, seconds=15) is not None
    assert touched_s(seed, LIMITS, seconds=15) is None
