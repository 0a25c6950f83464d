"""The lens's effects on a picture, and on the truth mask of the same picture."""

import math

import numpy as np
import pytest

from adatracker_deploy.perception.jpeg import decode_jpeg
from adatracker_deploy.sim.render.lens import PERFECT, Lens, bend, encode, expose, wider

FOV = math.radians(90.0)
BARREL = Lens(distortion=-0.1)


def disc(height, width, at, radius):
    rows, columns = np.mgrid[0:height, 0:width]
    return np.where(np.hypot(columns - at[0], rows - at[1]) < radius, 255, 0).astype(np.uint8)


def test_a_perfect_lens_changes_nothing():
    image = np.random.default_rng(0).integers(0, 256, (48, 64, 3)).astype(np.uint8)
    rng = np.random.default_rng(1)
    assert np.array_equal(expose(bend(image, PERFECT, FOV), PERFECT, (0.0, 0.0), rng), image)


def test_what_is_encoded_is_decoded_in_the_same_colours():
    image = np.full((48, 64, 3), (200, 60, 20), np.uint8)
    assert np.abs(decode_jpeg(encode(image, Lens())).astype(int) - image).max() < 8
    noise = np.random.default_rng(0).integers(0, 256, (48, 64, 3)).astype(np.uint8)
    assert len(encode(noise, Lens(jpeg_quality=30))) < len(encode(noise, Lens(jpeg_quality=90)))


def test_the_middle_stays_where_it_is_and_the_edge_comes_in():
    """The picture is rendered wider, so its middle shrinks; barrel distortion pulls the edge in further."""
    image = disc(480, 640, (319.5, 239.5), 20)
    bent = bend(image, BARREL, FOV)
    rows, columns = np.nonzero(bent > 127)
    assert abs(columns.mean() - 319.5) < 0.6
    assert abs(rows.mean() - 239.5) < 0.6


@pytest.mark.parametrize("distortion", [-0.09, -0.04, 0.1])
def test_no_corner_is_empty(distortion):
    """The distorted picture shows only what was rendered."""
    lens = Lens(distortion=distortion)
    ramp = np.tile(np.linspace(50, 250, 640).astype(np.uint8), (480, 1))
    bent = bend(ramp, lens, FOV)
    assert (np.diff(bent.astype(int), axis=1) >= 0).all()
    if distortion < 0:
        assert (np.diff(bent[0].astype(int))[:20] > -1).all()
        assert wider(FOV, lens, 480, 640) > FOV


def test_a_straight_ray_lands_where_browns_model_says():
    lens, width, height = Lens(distortion=-0.08), 640, 480
    wide = wider(FOV, lens, height, width)
    straight = 0.6  # of the half width, in the picture without distortion
    column = width / 2 + straight * (math.tan(FOV / 2) / math.tan(wide / 2)) * width / 2 - 0.5
    bent = bend(disc(height, width, (column, 239.5), 8), lens, FOV)
    _, columns = np.nonzero(bent > 127)
    expected = width / 2 + straight * (1 + lens.distortion * straight**2) * width / 2 - 0.5
    assert abs(columns.mean() - expected) < 1.0


def test_a_mask_keeps_its_values():
    mask = np.random.default_rng(0).integers(0, 4, (48, 64)).astype(np.uint8)
    assert set(np.unique(bend(mask, BARREL, FOV, nearest=True))) <= {0, 1, 2, 3}


def test_a_turning_camera_smears_along_the_turn():
    image = np.repeat(disc(96, 128, (64, 48), 3)[..., None], 3, axis=2)
    lens = Lens(distortion=0.0, exposure_s=0.02, noise=0.0)
    smeared = expose(image, lens, (600.0, 0.0), np.random.default_rng(0))
    rows, columns = np.nonzero(smeared[..., 0] > 20)
    assert np.ptp(columns) > np.ptp(rows) + 6
    assert int(smeared.sum()) == pytest.approx(int(image.sum()), rel=0.05)


def test_noise_is_as_strong_as_it_says_and_new_in_each_picture():
    image = np.full((96, 128, 3), 128, np.uint8)
    lens = Lens(distortion=0.0, noise=0.02)
    rng = np.random.default_rng(0)
    first, second = (expose(image, lens, (0.0, 0.0), rng).astype(float) for _ in range(2))
    assert first.std() == pytest.approx(0.02 * 255, rel=0.15)
    assert np.abs(first - second).mean() > 1.0
