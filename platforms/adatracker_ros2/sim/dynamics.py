"""The robot's dynamics: delay, lag, limits and slip of a base that may be able to move sideways."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_deploy.sim.bodies import DelayLine, GroundBody, along_arc, clipped, lag_share, within

if TYPE_CHECKING:
    from adatracker_ros2.sim.settings import SitlSettings


class Ros2Body(GroundBody):
    """A base on the ground.

    What its wheels roll (`measured`, `odometry`) is what it can tell; what it moves (`velocity`, `pose`) is
    less by what slips.
    """

    def __init__(self, settings: SitlSettings) -> None:
        """Stand at the origin."""
        self.settings = settings
        self.reset(Pose(), 0)

    def reset(self, pose: Pose, seed: int) -> None:
        """Stand still at `pose`, with this seed's slip; the odometry begins where the world's pose does."""
        self._grip = 1.0 - self.settings.slip * np.random.default_rng([seed, 0x2052]).uniform(0.0, 1.0)
        self._pose = self.odometry = pose
        self._delay = DelayLine(self.settings.delay_s)
        self.measured = ZERO

    def step(self, command: Twist, dt_s: float) -> None:
        """Advance by `dt_s` seconds; the vertical part is ignored, not finite means zero."""
        self._delay.give(clipped(command, self.settings, self.settings.lateral_m_s))
        wanted, before = self._delay.advance(dt_s), self.measured
        share = lag_share(self.settings.lag_s, dt_s)
        step, turn = self.settings.accel_m_s2 * dt_s, self.settings.yaw_accel_rad_s2 * dt_s
        self.measured = Twist(
            vx=before.vx + within(share * (wanted.vx - before.vx), step),
            vy=before.vy + within(share * (wanted.vy - before.vy), step),
            yaw_rate=before.yaw_rate + within(share * (wanted.yaw_rate - before.yaw_rate), turn),
        )
        if (
            wanted == ZERO
            and max(map(abs, (self.measured.vx, self.measured.vy, self.measured.yaw_rate))) < 1e-3
        ):
            self.measured = ZERO
        self.odometry = along_arc(self.odometry, self.measured, dt_s)
        self._pose = along_arc(self._pose, self.velocity, dt_s)

    @property
    def camera_pose(self) -> Pose:
        """Pose of the camera in its mount."""
        return self.settings.camera.pose(self._pose)

    @property
    def velocity(self) -> Twist:
        """The base's true velocity."""
        kept, rolls = self._grip, self.measured
        return Twist(vx=kept * rolls.vx, vy=kept * rolls.vy, yaw_rate=kept * rolls.yaw_rate)
