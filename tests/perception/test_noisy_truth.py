"""The truth of a rehearsal, with a real segmenter's noise: as much a second, however many frames."""

from __future__ import annotations

import numpy as np
import pytest

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Frame, Truth
from adatracker_deploy.perception.noisy_truth import NoisyTruth
from adatracker_deploy.perception.segmenter import check_observation

RATE_HZ = 20.0
MASK = np.zeros((64, 64), np.uint8)
MASK[16:56, 24:40] = 1
TRUTH = Truth(MASK, Pose(), Pose(), (2.5, 0.0), 2.5, 0.0)
RGB = np.zeros((64, 64, 3), np.uint8)


def watched(every, seconds=20, late_s=0.0):
    """The observation of each frame by its step of the noise; the camera gives one in `every`."""
    segmenter = NoisyTruth("embedded", RATE_HZ, seed=3)
    seen = {}
    for step in range(0, round(seconds * RATE_HZ), every):
        t_s = 7 + step / RATE_HZ + (late_s if step else 0)
        frame = Frame(RGB, round(t_s * 1e9), step, TRUTH)
        seen[step] = segmenter(frame)
        check_observation(seen[step], frame)
    return seen


@pytest.mark.parametrize("every", [2, 5])
def test_a_camera_that_skips_frames_has_the_same_gaps_at_the_same_times(every):
    whole, skipping = watched(1), watched(every)
    assert 0 < sum(each.box is None for each in whole.values()) < 0.4 * len(whole)
    for step, observation in skipping.items():
        np.testing.assert_array_equal(observation.mask, whole[step].mask)


@pytest.mark.parametrize("late_s", [-0.01, 0.02])
def test_frames_that_come_a_little_early_or_late_change_nothing(late_s):
    punctual = watched(1)
    for step, observation in watched(1, late_s=late_s).items():
        np.testing.assert_array_equal(observation.mask, punctual[step].mask)


def test_each_trial_has_other_noise_and_begins_with_the_truth():
    segmenter = NoisyTruth("embedded", RATE_HZ, seed=3)
    trials = []
    for _ in range(2):
        segmenter.reset()
        frames = [Frame(RGB, step * 50_000_000, step, TRUTH) for step in range(200)]
        trials.append([segmenter(frame) for frame in frames])
    first, second = trials
    np.testing.assert_array_equal(first[0].mask, MASK)
    np.testing.assert_array_equal(second[0].mask, MASK)
    assert [each.box is None for each in first] != [each.box is None for each in second]
