"""Bystanders cannot be recognised in a log, and the target can still be seen."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.messages import MaskClass
from adatracker_deploy.trial.privacy import LASTS_S, Anonymiser
from adatracker_deploy.trial.reader import read_trial
from tests.trial.records import a_frame, a_log, a_step, an_observation

RNG = np.random.default_rng(5)
NOISE = np.repeat(np.kron(RNG.integers(0, 2, (30, 40, 1)) * 255, np.ones((4, 4, 1))), 3, axis=2).astype(
    np.uint8
)
"""A pattern that shows at every pixel whether it was blurred, even after JPEG."""
SECOND_NS = 1_000_000_000


def mask_of(person=None, target=None, shape=(60, 80)):
    mask = np.zeros(shape, np.uint8)
    for value, place in ((MaskClass.PERSON, person), (MaskClass.TARGET, target)):
        if place is not None:
            mask[place] = value
    return mask


LEFT, RIGHT = np.s_[10:50, 5:25], np.s_[10:50, 50:75]


def changed(before, after):
    """Return which pixels of the mask's size show something else."""
    other = np.any(before != after, axis=2)
    return other.reshape(60, 2, 80, 2).mean(axis=(1, 3)) > 0.5


def test_persons_are_blurred_with_a_margin_and_the_target_is_not():
    shown = Anonymiser().cover(NOISE, mask_of(person=LEFT, target=RIGHT), 0)
    covered = changed(NOISE, shown)
    assert covered[LEFT].mean() > 0.97
    assert covered[9, 15]
    assert not covered[RIGHT].any()
    assert not covered[:, 30:].any()


def test_what_is_left_of_a_person_is_a_few_cells():
    shown = Anonymiser().cover(NOISE, mask_of(person=np.s_[:, :]), 0)
    assert np.abs(np.diff(shown.astype(int), axis=1)).max() < 40
    assert np.abs(np.diff(NOISE.astype(int), axis=1)).max() == 255


def test_a_person_whom_the_detector_misses_for_a_moment_stays_covered():
    veil = Anonymiser()
    veil.cover(NOISE, mask_of(person=LEFT), 0)
    missed = veil.cover(NOISE, mask_of(), round(LASTS_S * SECOND_NS) - 1)
    assert changed(NOISE, missed)[LEFT].mean() > 0.97
    assert np.array_equal(veil.cover(NOISE, mask_of(), round(LASTS_S * SECOND_NS)), NOISE)


def test_a_target_who_walks_where_somebody_was_is_seen():
    veil = Anonymiser()
    veil.cover(NOISE, mask_of(person=LEFT), 0)
    assert not changed(NOISE, veil.cover(NOISE, mask_of(target=LEFT), SECOND_NS // 2))[LEFT].any()


def test_a_lost_target_is_a_person_like_any_other():
    assert changed(NOISE, Anonymiser().cover(NOISE, mask_of(person=LEFT), 0))[LEFT].mean() > 0.97


@given(
    st.integers(1, 90), st.integers(1, 90), st.integers(1, 40), st.integers(1, 40), st.integers(0, 2**32 - 1)
)
def test_pictures_and_masks_of_any_size_are_covered(height, width, rows, columns, seed):
    rng = np.random.default_rng(seed)
    rgb = rng.integers(0, 256, (height, width, 3), np.uint8)
    before = rgb.copy()
    shown = Anonymiser().cover(rgb, rng.integers(0, 4, (rows, columns), np.uint8), 7)
    assert shown.shape == rgb.shape
    assert shown.dtype == np.uint8
    assert np.array_equal(rgb, before)


def logged(folder, frames, jpeg=True):
    """Log three noisy frames with a person at the left and the target at the right; return the trial."""
    observation = dataclasses.replace(an_observation(0), mask=mask_of(person=LEFT, target=RIGHT))
    quality = cv2.imencode(".jpg", NOISE[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, 60))[1].tobytes()
    with a_log(folder, frames=frames, config={"frames": frames}) as log:
        for number in range(3):
            frame = dataclasses.replace(a_frame(number), rgb=NOISE, jpeg=quality if jpeg else None)
            log.step(a_step(number), frame, dataclasses.replace(observation, seq=number))
    assert not log.trouble
    return read_trial(log.folder), quality


def test_a_cameras_own_jpeg_is_logged_as_it_came(tmp_path):
    trial, jpeg = logged(tmp_path, "full")
    assert [frame.jpeg for frame in trial.frames()] == [jpeg] * 3


def test_a_jpeg_longer_than_the_picture_is_encoded_anew(tmp_path):
    frame = dataclasses.replace(a_frame(0), jpeg=bytes(160 * 120 * 3))
    with a_log(tmp_path) as log:
        log.step(a_step(0), frame, an_observation(0))
    (logged_frame,) = read_trial(log.folder).frames()
    assert logged_frame.rgb.shape == (120, 160, 3)


@pytest.mark.parametrize("jpeg", [True, False])
def test_of_a_blurred_log_nobody_gets_the_picture_back(tmp_path, jpeg):
    trial, own = logged(tmp_path, "blurred", jpeg)
    for frame in trial.frames():
        covered = np.abs(frame.rgb.astype(int) - NOISE).mean(axis=2).reshape(60, 2, 80, 2).mean(axis=(1, 3))
        assert covered[LEFT].mean() > 2 * covered[RIGHT].mean()
    assert own not in trial.path.read_bytes()
    assert trial.frames_kept == "blurred"


def test_a_log_without_frames_has_masks_boxes_and_steps_and_no_picture(tmp_path):
    trial, own = logged(tmp_path, "none")
    assert len(trial.steps) == len(list(trial.masks())) == 3
    assert not list(trial.frames())
    assert not trial.frame_seqs
    assert trial.frames_kept == "none"
    data = trial.path.read_bytes()
    assert own not in data
    assert b"\xff\xd8\xff" not in data
    assert NOISE[0].tobytes() not in data
