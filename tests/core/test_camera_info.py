"""A lens: its field of view, and the simulated camera's as a calibration would find it."""

import math

import cv2
import numpy as np
import pytest

from adatracker_deploy.core.camera_info import CameraInfo
from adatracker_deploy.sim.render.lens import Lens, bend, wider


@pytest.mark.parametrize("degrees", [40, 90, 120])
def test_a_pinhole_has_the_field_of_view_that_it_was_made_of(degrees):
    lens = CameraInfo.pinhole(math.radians(degrees), 640, 480)
    assert math.degrees(lens.fov_rad) == pytest.approx(degrees)
    assert (lens.cx, lens.cy) == (319.5, 239.5)


def test_a_fisheyes_field_of_view_may_exceed_a_half_turn():
    lens = CameraInfo(
        width_px=1000, height_px=800, fx=286.5, fy=286.5, cx=499.5, cy=399.5, model="equidistant"
    )
    assert math.degrees(lens.fov_rad) == pytest.approx(200.0, abs=0.1)


def test_opencv_takes_the_simulated_lens_out_of_a_picture_by_its_camera_info():
    """A chart of squares, bent by the lens and straightened by OpenCV, is the chart that a pinhole sees."""
    fov_rad, width, height = math.radians(90), 640, 480
    info = Lens().camera_info(fov_rad, width, height)
    wide = math.tan(wider(fov_rad, Lens(), height, width) / 2) / math.tan(fov_rad / 2)
    bent = bend(chart(width, height, 40 / wide), Lens(), fov_rad)
    matrix = np.array([[info.fx, 0, info.cx], [0, info.fy, info.cy], [0, 0, 1]])
    straight = cv2.undistort(bent, matrix, np.array(info.coefficients))
    wanted = chart(width, height, 40)
    inside = (slice(20, -20), slice(20, -20))
    assert differing(straight[inside], wanted[inside]) < 0.02
    assert differing(bent[inside], wanted[inside]) > 0.15


def chart(width, height, square_px):
    """A chessboard around the picture's centre."""
    x, y = np.meshgrid(np.arange(width) - (width - 1) / 2, np.arange(height) - (height - 1) / 2)
    even = (np.floor(x / square_px) + np.floor(y / square_px)) % 2 == 0
    return np.where(even, 255, 0).astype(np.uint8)


def differing(one, other):
    return float((np.abs(one.astype(int) - other.astype(int)) > 128).mean())
