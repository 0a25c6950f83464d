"""The trot that the camera feels: at rest it is still, walking it bobs at the frequency it is said to."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.geometry import Pose
from adatracker_quadruped.sim.gait import Gait
from adatracker_quadruped.sim.settings import GaitSettings

EVEN = GaitSettings(uneven_m=0.0)
STEP_S = 0.01


def trunks(settings, pace, seconds, seed=0):
    gait = Gait(settings, np.random.default_rng(seed))
    poses = []
    for _ in range(round(seconds / STEP_S)):
        gait.step(pace, STEP_S)
        poses.append(gait.trunk)
    return poses


def frequency_hz(values, seconds):
    """By the crossings of the mean."""
    above = np.array(values) > np.mean(values)
    return np.count_nonzero(above[1:] & ~above[:-1]) / seconds


def test_a_robot_that_stands_is_still():
    assert set(trunks(GaitSettings(), 0.0, 2.0)) == {Pose()}


def test_a_trot_comes_to_rest_when_the_robot_does():
    gait = Gait(EVEN, np.random.default_rng(0))
    for _ in range(200):
        gait.step(1.0, STEP_S)
    for _ in range(200):
        gait.step(0.0, STEP_S)
    assert gait.trunk.z == pytest.approx(0.0, abs=1e-6)
    assert gait.trunk.roll == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("pace", "cycles_hz"), [(0.01, 2.01), (0.5, 2.5), (1.0, 3.0)])
def test_the_trunk_rolls_once_a_cycle_and_bobs_twice_and_faster_with_speed(pace, cycles_hz):
    poses = trunks(EVEN, pace, 12.0)[200:]
    assert frequency_hz([pose.roll for pose in poses], 10.0) == pytest.approx(cycles_hz, abs=0.15)
    assert frequency_hz([pose.z for pose in poses], 10.0) == pytest.approx(2 * cycles_hz, abs=0.15)
    assert frequency_hz([pose.pitch for pose in poses], 10.0) == pytest.approx(2 * cycles_hz, abs=0.15)


def test_the_amplitudes_are_those_of_the_settings():
    poses = trunks(EVEN, 1.0, 6.0)[200:]
    assert max(pose.z for pose in poses) == pytest.approx(EVEN.bob_m, rel=0.02)
    assert math.degrees(max(pose.roll for pose in poses)) == pytest.approx(EVEN.roll_deg, rel=0.02)
    assert math.degrees(max(pose.pitch for pose in poses)) == pytest.approx(EVEN.pitch_deg, rel=0.02)


def test_uneven_ground_tilts_the_trunk_differently_at_each_step_and_from_seed_to_seed():
    rough = GaitSettings(bob_m=0.0, pitch_deg=0.0, roll_deg=0.0, uneven_m=0.02)
    one, other = trunks(rough, 0.5, 4.0, seed=1), trunks(rough, 0.5, 4.0, seed=2)
    assert one != other
    assert one == trunks(rough, 0.5, 4.0, seed=1)
    assert np.std([math.degrees(pose.roll) for pose in one]) > 1.0
    assert np.std([pose.z for pose in one]) == pytest.approx(0.02 / 2, rel=0.6)


@given(st.lists(st.floats(0, 1), min_size=10, max_size=60))
def test_the_trunk_never_jumps(paces):
    settings = GaitSettings()
    gait = Gait(settings, np.random.default_rng(0))
    before = gait.trunk
    for pace in paces:
        gait.step(pace, STEP_S)
        trunk = gait.trunk
        assert abs(trunk.z - before.z) < 0.015
        assert abs(trunk.roll - before.roll) < math.radians(3)
        assert abs(trunk.pitch - before.pitch) < math.radians(3)
        before = trunk
