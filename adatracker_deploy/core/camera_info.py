"""A camera's lens, as its calibration or its profile tells it. No policy sees it.

Whoever looks at a trial elsewhere may need it: it is in the log, and in a bag for ROS 2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

FISHEYE = "equidistant"
"""The one model here in which a distance from the centre is an angle (sensor_msgs/distortion_models.hpp)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraInfo:
    """Focal lengths and centre of a camera's pictures, px, and their distortion.

    As in OpenCV, whose calibrations these are, the centre of the first pixel is (0, 0).
    """

    width_px: int
    height_px: int
    fx: float
    fy: float
    cx: float
    cy: float
    model: str = "plumb_bob"
    """By the names of sensor_msgs/CameraInfo."""
    coefficients: tuple[float, ...] = ()
    """In the model's order; none of a picture without distortion."""

    @classmethod
    def pinhole(cls, fov_rad: float, width_px: int, height_px: int) -> CameraInfo:
        """Return a lens without distortion, by its horizontal field of view."""
        focal_px = width_px / (2 * math.tan(fov_rad / 2))
        return cls(
            width_px=width_px,
            height_px=height_px,
            fx=focal_px,
            fy=focal_px,
            cx=(width_px - 1) / 2,
            cy=(height_px - 1) / 2,
        )

    @property
    def fov_rad(self) -> float:
        """Horizontal field of view by the focal length alone, which is what a lens is sold by."""
        if self.model == FISHEYE:
            return self.width_px / self.fx
        return 2 * math.atan(self.width_px / (2 * self.fx))
