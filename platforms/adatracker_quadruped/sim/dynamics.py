"""The quadruped's dynamics: first-order lag, foot slip and a trotting trunk."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_deploy.sim.bodies import DelayLine, GroundBody, along_arc, clipped, lag_share
from adatracker_quadruped.sim.gait import Gait

if TYPE_CHECKING:
    from adatracker_quadruped.sim.settings import SitlSettings

_STEP_S = 0.01
"""Longest step of the integration: a trot has fifty of them to a cycle."""
_STANDING_M_S = 0.02
"""And rad/s: slower than this, without a command, the robot puts all feet down and stands."""


class QuadrupedBody(GroundBody):
    """A walking robot on the ground: forward, lateral and turning velocities follow by a first-order lag.

    A vertical command is ignored; one that is not finite counts as zero. The gait moves the camera, not the
    body's origin, which stays on the ground.
    """

    def __init__(self, settings: SitlSettings) -> None:
        """Stand at the origin."""
        self.settings = settings
        self.reset(Pose(), 0)

    def reset(self, pose: Pose, seed: int) -> None:
        """Stand still at `pose`; slip and uneven ground are drawn from `seed`."""
        self._random = np.random.default_rng(seed)
        self._gait = Gait(self.settings.gait, self._random)
        self._mean_slip = self.settings.slip * self._random.uniform(0.0, 2.0)
        self._slip = self._mean_slip
        self._pose = pose
        self._legs = ZERO
        self._delay = DelayLine(self.settings.delay_s)

    def step(self, command: Twist, dt_s: float) -> None:
        """Advance by `dt_s` seconds under a velocity command in the body frame."""
        self._delay.give(clipped(command, self.settings, self.settings.lateral_m_s))
        steps = max(1, math.ceil(dt_s / _STEP_S - 1e-9))
        for _ in range(steps):
            self._advance(dt_s / steps)

    @property
    def trunk(self) -> Pose:
        """The body's origin with the gait's motion: what an IMU in the trunk feels."""
        return self._pose @ self._gait.trunk

    @property
    def camera_pose(self) -> Pose:
        """Pose of the camera in its mount, moved by the gait."""
        return self.settings.camera.pose(self.trunk)

    @property
    def velocity(self) -> Twist:
        """The velocity over the ground now: what the legs do, less what slips."""
        kept = 1.0 - self._slip
        legs = self._legs
        return Twist(vx=kept * legs.vx, vy=kept * legs.vy, yaw_rate=kept * legs.yaw_rate)

    def _advance(self, dt_s: float) -> None:
        self._legs = self._lagged(self._delay.advance(dt_s), dt_s)
        if self._gait.step(self._pace(), dt_s):
            self._slip = self._mean_slip * self._random.uniform(0.0, 2.0)
        self._pose = along_arc(self._pose, self.velocity, dt_s)

    def _lagged(self, command: Twist, dt_s: float) -> Twist:
        share, legs = lag_share(self.settings.lag_s, dt_s), self._legs
        vx, vy, yaw_rate = (
            now + share * (wanted - now)
            for now, wanted in (
                (legs.vx, command.vx),
                (legs.vy, command.vy),
                (legs.yaw_rate, command.yaw_rate),
            )
        )
        if command == ZERO and max(abs(vx), abs(vy), abs(yaw_rate)) < _STANDING_M_S:
            return ZERO
        return Twist(vx=vx, vy=vy, yaw_rate=yaw_rate)

    def _pace(self) -> float:
        """Return the speed as a share of the largest, 0 to 1; turning on the spot is walking too."""
        legs, settings = self._legs, self.settings
        walking = math.hypot(legs.vx, legs.vy) / settings.forward_m_s
        return min(1.0, walking + abs(legs.yaw_rate) / settings.yaw_rate_rad_s)
