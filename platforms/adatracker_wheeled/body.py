"""The base's dynamics: wheels that follow commands with a delay, a lag and limits, and that slip."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.geometry import Pose, wrap_angle
from adatracker_deploy.platform import ZERO, Twist
from adatracker_deploy.world.bodies import GroundBody
from adatracker_wheeled.drive import Drive
from adatracker_wheeled.roles import Wheels

if TYPE_CHECKING:
    from adatracker_wheeled.roles import Roles
    from adatracker_wheeled.settings import SitlSettings

_TRACK_M = 0.5
"""Of a base whose profile does not tell it: nothing on its wire depends on it."""


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
        self._now_s = 0.0
        self._command = ZERO
        self._pending: deque[tuple[float, Twist]] = deque()
        self.measured = self._velocity = ZERO
        self.wheels_m = (0.0, 0.0)
        """Distance that the left and the right wheels have rolled, m."""

    def step(self, command: Twist, dt_s: float) -> None:
        """Advance by `dt_s` seconds; sideways and upward parts are ignored, not finite means zero."""
        self._pending.append((self._now_s + self.settings.delay_s, self._clip(command)))
        # Half a nanosecond forgives the rounding of summed steps.
        while self._pending and self._pending[0][0] <= self._now_s + 0.5e-9:
            self._command = self._pending.popleft()[1]
        self._now_s += dt_s
        self.measured = self._follow(dt_s)
        self._roll(dt_s)

    def place(self, pose: Pose) -> None:
        """Be at `pose`, at the same speed: an obstacle stops the body, not its wheels."""
        self._pose = pose

    @property
    def pose(self) -> Pose:
        """Where the base really is."""
        return self._pose

    @property
    def camera_pose(self) -> Pose:
        """Where the mount puts the camera."""
        return self.settings.camera.pose(self._pose)

    @property
    def velocity(self) -> Twist:
        """How the base really moves."""
        return self._velocity

    def _clip(self, command: Twist) -> Twist:
        if not command.is_finite():
            return ZERO
        settings = self.settings
        vx = max(-settings.backward_m_s, min(settings.forward_m_s, command.vx))
        return Twist(vx=vx, yaw_rate=_within(command.yaw_rate, settings.yaw_rate_rad_s))

    def _follow(self, dt_s: float) -> Twist:
        """Return what the wheels amount to after `dt_s`; a steered base turns only as it rolls."""
        settings, before, wanted = self.settings, self.measured, self._command
        share = 1.0 - math.exp(-dt_s / settings.lag_s) if settings.lag_s > 0 else 1.0
        vx = before.vx + _within(share * (wanted.vx - before.vx), settings.accel_m_s2 * dt_s)
        turn = _within(share * (wanted.yaw_rate - before.yaw_rate), settings.yaw_accel_rad_s2 * dt_s)
        return self._drive.twist(self._drive.quantities(Twist(vx=vx, yaw_rate=before.yaw_rate + turn)))

    def _roll(self, dt_s: float) -> None:
        """Turn the wheels for `dt_s`; move along the arc that their grip leaves of it."""
        rims = self._wheels.quantities(self.measured)
        left, right = rims["left_m_s"], rims["right_m_s"]
        self.wheels_m = (self.wheels_m[0] + left * dt_s, self.wheels_m[1] + right * dt_s)
        grip_left, grip_right = self._grip.tolist()
        self._velocity = self._wheels.twist({"left_m_s": left * grip_left, "right_m_s": right * grip_right})
        at, turn = self._pose, self._velocity.yaw_rate * dt_s
        ahead, along = self._velocity.vx * dt_s * math.cos(at.pitch), at.yaw + turn / 2
        self._pose = Pose(
            at.x + ahead * math.cos(along),
            at.y + ahead * math.sin(along),
            at.z,
            at.roll,
            at.pitch,
            wrap_angle(at.yaw + turn),
        )


def _within(value: float, magnitude: float) -> float:
    return max(-magnitude, min(magnitude, value))
