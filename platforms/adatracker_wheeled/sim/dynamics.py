"""The base's dynamics: delay, lag, limits and wheel slip."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_deploy.sim.bodies import DelayLine, GroundBody, along_arc, clipped, lag_share, within
from adatracker_wheeled.protocol.kinematics import Drive
from adatracker_wheeled.protocol.roles import Wheels

if TYPE_CHECKING:
    from adatracker_wheeled.protocol.roles import Roles
    from adatracker_wheeled.sim.settings import SitlSettings

_TRACK_M = 0.5
"""Track of a base whose profile does not state it; none of its messages depends on it."""


class WheeledBody(GroundBody):
    """A base on wheels; its origin is the midpoint between the driven ones, on the ground.

    What the wheels roll (`measured`, `wheels_m`) is what the base itself can tell; what they move
    (`velocity`, `pose`) is less by each side's slip.
    """

    def __init__(self, settings: SitlSettings, roles: Roles) -> None:
        """Stand at the origin, with the geometry that the profile's roles state."""
        self.settings = settings
        self._wheels = Drive(wheels=roles.wheels or Wheels(track_m=_TRACK_M))
        self._drive = Drive(steering=roles.steering)
        self.reset(Pose(), 0)

    def reset(self, pose: Pose, seed: int) -> None:
        """Stand still at `pose`, with this seed's slip."""
        random = np.random.default_rng([seed, 0x5117])
        self._grip = 1.0 - self.settings.slip * random.uniform(0.0, 1.0, 2)
        self._pose = pose
        self._delay = DelayLine(self.settings.delay_s)
        self.measured = self._velocity = ZERO
        self.wheels_m = (0.0, 0.0)
        """Distance that the left and the right wheels have rolled, m."""

    def step(self, command: Twist, dt_s: float) -> None:
        """Advance by `dt_s` seconds; sideways and upward parts are ignored, not finite means zero."""
        self._delay.give(clipped(command, self.settings))
        self.measured = self._follow(self._delay.advance(dt_s), dt_s)
        self._roll(dt_s)

    @property
    def camera_pose(self) -> Pose:
        """Pose of the camera in its mount."""
        return self.settings.camera.pose(self._pose)

    @property
    def velocity(self) -> Twist:
        """The base's true velocity."""
        return self._velocity

    def _follow(self, wanted: Twist, dt_s: float) -> Twist:
        """Return what the wheels amount to after `dt_s`; a steered base turns only as it rolls."""
        settings, before = self.settings, self.measured
        share = lag_share(settings.lag_s, dt_s)
        vx = before.vx + within(share * (wanted.vx - before.vx), settings.accel_m_s2 * dt_s)
        turn = within(share * (wanted.yaw_rate - before.yaw_rate), settings.yaw_accel_rad_s2 * dt_s)
        return self._drive.twist(self._drive.quantities(Twist(vx=vx, yaw_rate=before.yaw_rate + turn)))

    def _roll(self, dt_s: float) -> None:
        """Turn the wheels for `dt_s`; move along the arc that their grip leaves of it."""
        rims = self._wheels.quantities(self.measured)
        left, right = rims["left_m_s"], rims["right_m_s"]
        self.wheels_m = (self.wheels_m[0] + left * dt_s, self.wheels_m[1] + right * dt_s)
        grip_left, grip_right = self._grip.tolist()
        self._velocity = self._wheels.twist({"left_m_s": left * grip_left, "right_m_s": right * grip_right})
        self._pose = along_arc(self._pose, self._velocity, dt_s)
