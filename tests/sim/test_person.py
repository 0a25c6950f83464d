from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.sim.person import HEIGHT_M, LIMBS, Gait, posture

FEET = [index for index, limb in enumerate(LIMBS) if limb.role == "shoes"]
GAITS = st.builds(Gait, st.floats(0, math.tau), st.floats(0, 4))


def soles(gait: Gait) -> list[float]:
    centres, _ = posture(gait)
    return [float(centres[foot, 2]) - LIMBS[foot].half[2] for foot in FEET]


@given(GAITS)
def test_the_lower_foot_stands_on_the_ground(gait):
    assert min(soles(gait)) == pytest.approx(0.0, abs=1e-9)


def test_somebody_who_stands_is_as_tall_as_stated():
    centres, _ = posture(Gait())
    tops = centres[:, 2] + [limb.half[2] for limb in LIMBS]
    assert tops.max() == pytest.approx(HEIGHT_M, abs=0.02)


def test_legs_swing_against_each_other_and_arms_against_the_legs():
    gait = Gait(phase_rad=math.pi / 2, speed_m_s=1.0)
    centres, _ = posture(gait)
    left_foot, right_foot = (centres[foot, 0] for foot in FEET)
    left_forearm, right_forearm = centres[6, 0], centres[11, 0]
    assert left_foot > 0.2 > -0.2 > right_foot
    assert left_forearm < right_forearm


def test_the_swing_follows_the_distance_walked_and_ends_at_rest():
    gait = Gait()
    for _ in range(20):
        gait.walk(0.1, 0.1)
    walking = gait.phase_rad
    for _ in range(30):
        gait.walk(0.0, 0.1)
    assert gait.phase_rad == walking
    assert soles(gait) == pytest.approx([0.0, 0.0], abs=1e-3)


def test_two_steps_at_one_metre_a_second_cover_1_4_metres():
    gait = Gait()
    for _ in range(140):
        gait.walk(0.01, 0.01)
    assert math.sin(gait.phase_rad) == pytest.approx(0.0, abs=1e-6)
