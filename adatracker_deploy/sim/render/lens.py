"""The camera behind the pinhole: distortion, motion blur, exposure, noise and JPEG. Pure.

What a picture goes through in the order in which light does: the lens bends it, motion during the exposure
smears it, the sensor adds noise, the encoder its blocks. A truth mask is bent as its picture is.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.camera_info import CameraInfo

Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, kw_only=True)
class Lens:
    """A camera's faults; the defaults are those of a small robot camera by daylight."""

    distortion: float = -0.08
    """k1 of Brown's radial model, by the half width: below 0 a barrel; at least -0.09, where the model ends
    at the corners of a 4:3 picture."""
    exposure_s: float = 0.008
    gain: float = 1.0
    """Brightness, times what would be right."""
    noise: float = 0.012
    """Standard deviation of a pixel, share of full scale."""
    jpeg_quality: int = 85
    """1 to 100."""

    def camera_info(self, fov_rad: float, width: int, height: int) -> CameraInfo:
        """Return what a calibration of this camera would find; `fov_rad` as for `bend`."""
        straight = CameraInfo.pinhole(fov_rad, width, height)
        k1 = self.distortion / math.tan(fov_rad / 2) ** 2  # by the half width here, by the focal length there
        return replace(straight, coefficients=(k1, 0.0, 0.0, 0.0, 0.0))


PERFECT = Lens(distortion=0.0, exposure_s=0.0, noise=0.0, jpeg_quality=100)


def bend(image: Image, lens: Lens, fov_rad: float, *, nearest: bool = False) -> Image:
    """Return an image as the lens shows it.

    Args:
        image: (H, W) or (H, W, 3), drawn with a wider field of view, see `wider`.
        lens: the lens.
        fov_rad: of the image that comes out.
        nearest: keep the values themselves, as of a mask.
    """
    if not lens.distortion:
        return image
    height, width = image.shape[:2]
    cells, parts = _bent(width, height, fov_rad, lens.distortion, nearest=nearest)
    flags = cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR
    return np.asarray(cv2.remap(image, cells, parts, flags, borderMode=cv2.BORDER_REPLICATE), np.uint8)


def wider(fov_rad: float, lens: Lens, height: int, width: int) -> float:
    """Return the field of view to draw, so that the bent image has no empty corner."""
    if not lens.distortion:
        return fov_rad
    corner = math.hypot(1.0, height / width)
    stretch = 1.0 / (1.0 + min(lens.distortion, 0.0) * corner**2)
    return 2.0 * math.atan(math.tan(fov_rad / 2) * stretch)


@functools.lru_cache(maxsize=8)
def _bent(width: int, height: int, fov_rad: float, k1: float, *, nearest: bool) -> tuple[Any, Any]:
    """Return where each pixel of the bent image comes from in the straight, wider one, for OpenCV."""
    wide = math.tan(wider(fov_rad, Lens(distortion=k1), height, width) / 2) / math.tan(fov_rad / 2)
    x, y = np.meshgrid(
        (np.arange(width) + 0.5 - width / 2) / (width / 2),
        (np.arange(height) + 0.5 - height / 2) / (width / 2),
    )
    # Brown: bent = straight * (1 + k1 r^2); solved for the straight radius by fixed-point iteration.
    radius = np.hypot(x, y)
    straight = radius.copy()
    for _ in range(12):
        straight = radius / (1.0 + k1 * straight**2)
    scale = np.where(radius > 0, straight / np.maximum(radius, 1e-9), 1.0) / wide
    across, down = x * scale * width / 2 + width / 2 - 0.5, y * scale * width / 2 + height / 2 - 0.5
    cells, parts = cv2.convertMaps(
        across.astype(np.float32), down.astype(np.float32), cv2.CV_16SC2, nninterpolation=nearest
    )
    return cells, parts


def expose(image: Image, lens: Lens, turn_px_s: tuple[float, float], rng: np.random.Generator) -> Image:
    """Return what the sensor makes of an image (H, W, 3).

    Args:
        image: as bent.
        lens: exposure, gain and noise.
        turn_px_s: how fast the picture moves across the sensor, right and down.
        rng: of the noise.
    """
    smeared = _smeared(image, turn_px_s[0] * lens.exposure_s, turn_px_s[1] * lens.exposure_s)
    if not lens.noise and lens.gain == 1.0:
        return smeared
    # One table of noise is drawn once and read from a random place each time: drawing it anew takes longer
    # than all the rest.
    height, width = image.shape[:2]
    table = _noise_table(height, width, lens.noise)
    top, left = rng.integers(0, 64, 2)
    noise = table[top : top + height, left : left + width]
    bright = smeared if lens.gain == 1.0 else cv2.convertScaleAbs(smeared, alpha=lens.gain)
    return np.asarray(cv2.add(bright, noise, dtype=cv2.CV_8U), np.uint8)


@functools.lru_cache(maxsize=4)
def _noise_table(height: int, width: int, noise: float) -> NDArray[np.int16]:
    rng = np.random.default_rng(0)
    return np.round(255.0 * noise * rng.standard_normal((height + 64, width + 64, 3))).astype(np.int16)


def _smeared(image: Image, right_px: float, down_px: float) -> Image:
    length = math.hypot(right_px, down_px)
    if length < 1.0:
        return image
    size = 2 * math.ceil(length / 2) + 1
    kernel = np.zeros((size, size), np.float32)
    for share in np.linspace(-0.5, 0.5, 4 * size):
        column, row = size / 2 + share * right_px, size / 2 + share * down_px
        kernel[min(int(row), size - 1), min(int(column), size - 1)] += 1.0
    return np.asarray(cv2.filter2D(image, -1, kernel / kernel.sum()), np.uint8)


def encode(image: Image, lens: Lens) -> bytes:
    """Return an RGB image (H, W, 3) as JPEG."""
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    done, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, lens.jpeg_quality])
    assert done
    return bytes(data)
