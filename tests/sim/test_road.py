"""A rough road tilts the camera as ISO 8608's spectrum says, and only while the body drives."""

from __future__ import annotations

import math

import numpy as np
import pytest

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.sim.road import ROUGHNESS_M3, TRACK_M, WHEELBASE_M, Road

CAMERA = Pose(z=1.0, pitch=0.1)


def ridden(road, *, metres, step_m=0.1):
    """Return roll and pitch beyond the camera's own after each step ahead, (N, 2), rad."""
    poses = [road.tilted(CAMERA, Pose(x=x)) for x in np.arange(0.0, metres, step_m).tolist()]
    return np.array([(pose.roll, pose.pitch - CAMERA.pitch) for pose in poses])


@pytest.mark.parametrize("road", ["A", "B", "C", "D"])
def test_the_tilt_is_as_large_as_the_class_says(road):
    """By numerical integration of the spectrum: the variance of two wheels' difference in height."""
    frequency = np.linspace(1e-4, 200.0, 2_000_000)
    density = ROUGHNESS_M3[road] * (frequency / 0.1) ** -2
    tilts = ridden(Road(road, 3), metres=2000.0)
    for tilt, long_m in zip(tilts.T, (TRACK_M, WHEELBASE_M), strict=True):
        apart = density * 2.0 * (1.0 - np.cos(math.tau * frequency * long_m))
        wanted = math.sqrt(float(apart.sum()) * (frequency[1] - frequency[0])) / long_m
        assert tilt.std() == pytest.approx(wanted, rel=0.1)


def test_bumps_farther_apart_than_the_wheels_are_independent_and_nearer_ones_are_not():
    pitch = ridden(Road("C", 1), metres=2000.0)[:, 1]
    after = [np.corrcoef(pitch[:-lag], pitch[lag:])[0, 1] for lag in (1, 10)]
    assert after[0] == pytest.approx(1.0 - 0.1 / WHEELBASE_M, abs=0.06)
    assert abs(after[1]) < 0.1


def test_a_body_that_stands_is_still_and_a_smooth_road_changes_nothing():
    road = Road("D", 2)
    assert len({road.tilted(CAMERA, Pose(x=1.0)) for _ in range(5)}) == 1
    assert Road("smooth", 2).tilted(CAMERA, Pose(x=1.0)) is CAMERA


def test_the_same_seed_gives_the_same_bumps():
    first, second, third = (ridden(Road("C", seed), metres=5.0) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(first, third)
