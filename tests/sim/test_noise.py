"""Noise spoils masks as its settings say, repeats by seed, and leaves the first mask alone."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.sim.noise import NOISE, MaskNoise, NoiseSettings

STEPS = 4000


def person(column: int = 28) -> np.ndarray:
    mask = np.zeros((64, 64), np.uint8)
    mask[20:50, column : column + 8] = MaskClass.TARGET
    return mask


def augmented(settings_, masks, seed=0):
    noise = MaskNoise(settings_, seed)
    return [noise(mask) for mask in masks]


def test_without_noise_every_mask_passes_as_it_is():
    for seen, dropped in augmented(NOISE["none"], [person(c) for c in range(40)]):
        assert not dropped
        assert seen.sum() == person().sum()


@settings(max_examples=30, deadline=None)
@given(level=st.sampled_from(sorted(NOISE)), seed=st.integers(0, 1 << 40))
def test_the_first_mask_is_spared_and_equal_seeds_spoil_equally(level, seed):
    masks = [person(c % 50) for c in range(60)]
    once, again = (augmented(NOISE[level], masks, seed) for _ in range(2))
    assert np.array_equal(once[0][0], masks[0])
    for (a, lost_a), (b, lost_b) in zip(once, again, strict=True):
        assert lost_a == lost_b
        assert np.array_equal(a, b)
        assert a.shape == (64, 64)
        assert a.dtype == np.uint8
        assert a.max() <= MaskClass.OBSTACLE


@pytest.mark.parametrize("mean_drop", [1.0, 1.5, 4.0])
def test_five_percent_of_the_frames_are_dropped_however_long_the_runs(mean_drop):
    settings_ = NoiseSettings(dropped=0.05, mean_drop=mean_drop)
    lost = [dropped for _, dropped in augmented(settings_, [person()] * 5 * STEPS)]
    assert np.mean(lost) == pytest.approx(0.05, abs=0.01)


def test_a_dropped_frame_is_empty_or_the_one_before():
    masks = [person(c % 50) for c in range(STEPS)]
    seen = augmented(NoiseSettings(dropped=0.2), masks)
    kinds = set()
    for (before, _), (now, dropped), true in zip(seen, seen[1:], masks[1:], strict=False):
        if not dropped:
            assert np.array_equal(now, true)
        else:
            kinds.add("empty" if not now.any() else "held")
            assert not now.any() or np.array_equal(now, before) or not before.any()
    assert kinds == {"empty", "held"}


def test_ragged_edges_stay_within_their_reach():
    for seen, _ in augmented(NoiseSettings(ragged_px=2), [person()] * 50)[1:]:
        assert (seen != person()).any()
        outside = seen.copy()
        outside[17:53, 25:39] = 0  # the reach of 2 px, and what a cubic curve overshoots
        assert not outside.any()
        assert (seen[24:46, 31:33] == MaskClass.TARGET).all()


@pytest.mark.parametrize("ragged_px", [0.22, 1])
def test_edges_of_a_wider_mask_are_as_ragged_in_proportion(ragged_px):
    settings_ = NoiseSettings(ragged_px=ragged_px)

    def iou(mask):
        shared = [
            np.count_nonzero((seen == MaskClass.TARGET) & (mask == MaskClass.TARGET))
            / np.count_nonzero((seen == MaskClass.TARGET) | (mask == MaskClass.TARGET))
            for seen, _ in augmented(settings_, [mask] * 50)[1:]
        ]
        return np.mean(shared)

    assert iou(person()) < 0.97
    assert iou(person().repeat(5, axis=0).repeat(5, axis=1)) == pytest.approx(iou(person()), abs=0.03)


def test_false_blobs_come_in_every_class_and_go_again():
    empty = np.zeros((64, 64), np.uint8)
    seen = [mask for mask, _ in augmented(NoiseSettings(blobs=0.05), [empty] * STEPS)]
    assert {int(v) for mask in seen for v in np.unique(mask)} == {0, 1, 2, 3}
    assert 0.1 < np.mean([mask.any() for mask in seen]) < 0.5
    assert not empty.any()


def test_a_blackout_hides_the_target_alone_for_a_second_or_more():
    mask = person()
    mask[:10, :10] = MaskClass.OBSTACLE
    settings_ = NoiseSettings(blackouts=0.02, blackout=(10, 25))
    hidden = [not (seen == MaskClass.TARGET).any() for seen, _ in augmented(settings_, [mask] * STEPS)]
    runs = [len(run) for run in "".join("x" if h else " " for h in hidden).split()]
    assert runs
    assert min(runs) >= 10
    assert all((seen == MaskClass.OBSTACLE).any() for seen, _ in augmented(settings_, [mask] * 100))


@pytest.mark.parametrize("steps", [1, 3])
def test_latency_shows_the_mask_of_so_many_steps_before(steps):
    masks = [person(c) for c in range(20)]
    late = dataclasses.replace(NOISE["none"], latency=(steps, steps))
    seen = [mask for mask, _ in augmented(late, masks)]
    for t in range(steps, 20):
        assert np.array_equal(seen[t], masks[t - steps])
