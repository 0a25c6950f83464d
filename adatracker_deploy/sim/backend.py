"""Interface of a simulated world to an episode: `world.World` here, or Unreal's engine."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

import numpy as np

from adatracker_deploy.core.messages import Truth
from adatracker_deploy.sim.person import HEIGHT_M

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from adatracker_deploy.core.geometry import Pose
    from adatracker_deploy.core.messages import ClassMask, Contact

Point = tuple[float, float, float]


class WorldBackend(Protocol):
    """A world with a target person and others, one episode long. Poses are in its own fixed frame.

    A step is `grounded` for each step of a ground body's dynamics, `step`, then the pictures and the truth of
    the moment.
    """

    start: Pose
    """Starting pose of a robot: on the ground, 2.5 m behind the target, facing it."""

    @property
    def target_xy(self) -> tuple[float, float]:
        """The target's position, m."""

    def grounded(self, pose: Pose, radius_m: float) -> Pose:
        """Return the pose at which a ground body of this radius ends up when it heads for `pose`."""

    def step(self, dt_s: float, robot: Pose | None = None) -> None:
        """Let everybody walk for `dt_s` >= 0 seconds while the robot is at `robot`."""

    def render_mask(self, camera: Pose, fov_rad: float, height: int, width: int) -> ClassMask:
        """Return the class mask (height, width) that a camera at this pose sees; `fov_rad` is horizontal."""

    def render(
        self, camera: Pose, fov_rad: float, height: int, width: int
    ) -> tuple[ClassMask, NDArray[np.uint8]]:
        """Return the class mask (height, width) and an RGB image (height, width, 3), both uint8."""

    def picture(
        self, camera: Pose, fov_rad: float, height: int, width: int
    ) -> tuple[ClassMask, NDArray[np.uint8]]:
        """Return the class mask (height, width) and a picture (height, width, 3) for a real detector."""

    def truth(
        self, mask: ClassMask, robot: Pose, camera: Pose, radius_m: float, fov_rad: float | None = None
    ) -> Truth:
        """Return the ground truth for the moment at which `mask` was rendered."""


def truth_of(
    mask: ClassMask,
    robot: Pose,
    camera: Pose,
    target: Point,
    fov_rad: float | None,
    *,
    contact: Contact | None,
) -> Truth:
    """Return the ground truth of a moment.

    Args:
        mask: shape (H, W).
        robot: the body's pose.
        camera: the camera's.
        target: where the target stands: its feet.
        fov_rad: the mask's horizontal field of view; without one, the target is taken to be in view.
        contact: what the robot touches.
    """
    x, y, _ = target
    return Truth(
        mask=mask,
        robot=robot,
        camera=camera,
        target_xy=(x, y),
        distance_m=robot.distance_to(x, y),
        bearing_rad=robot.bearing_to(x, y),
        contact=contact,
        in_view=fov_rad is None or _in_view(camera, fov_rad, mask.shape[0] / mask.shape[1], target),
    )


def _in_view(camera: Pose, fov_rad: float, aspect: float, target: Point) -> bool:
    """Return whether the picture, `aspect` as high as wide, holds a part of where the target stands."""
    x, y, foot = target
    up = np.linspace(0.05, HEIGHT_M, 9) + foot
    body = np.stack([np.full(9, x), np.full(9, y), up], axis=1) - camera.translation()
    ahead, left, above = (body @ camera.rotation()).T
    half = math.tan(fov_rad / 2)
    inside = (ahead > 0) & (np.abs(left) <= half * ahead) & (np.abs(above) <= half * aspect * ahead)
    return bool(inside.any())
