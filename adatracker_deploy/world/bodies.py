"""Bodies on the ground: what the world may do to them, and a differential drive to reuse."""

from __future__ import annotations

import abc
import math
from collections import deque
from dataclasses import dataclass, field
from typing import Annotated

from adatracker_deploy.geometry import Pose, wrap_angle
from adatracker_deploy.platform import ZERO, Body, CameraMount, Twist
from adatracker_deploy.schema import Range


class GroundBody(Body):
    """A body that stands on the ground, and so is carried by it and stopped by what stands on it."""

    @abc.abstractmethod
    def place(self, pose: Pose) -> None:
        """Be at `pose` instead of where the last step led; velocity and everything else stay as they are."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveSettings:
    """What a differential drive is like."""

    camera: CameraMount = field(default_factory=CameraMount)
    forward_m_s: Annotated[float, Range(0, 30)] = 1.5
    """Largest speed forward; commands beyond a limit are clipped."""
    backward_m_s: Annotated[float, Range(0, 30)] = 0.5
    yaw_rate_rad_s: Annotated[float, Range(0, 10)] = 2.0
    lag_s: Annotated[float, Range(0, 2)] = 0.0
    """Time constant with which both velocities follow their commands; 0 follows at once."""
    delay_s: Annotated[float, Range(0, 2)] = 0.0
    """From a command to its first effect."""


class KinematicBody(GroundBody):
    """A differential drive: forward speed and yaw rate follow their commands by a first-order lag.

    Lateral and vertical commands are ignored. A command that is not finite stands for zero, as the gate would
    have it.
    """

    def __init__(self, settings: DriveSettings) -> None:
        """Stand at the origin."""
        self.settings = settings
        self.reset(Pose(), 0)

    def reset(self, pose: Pose, seed: int) -> None:
        """Stand still at `pose`; nothing here is random."""
        del seed
        self._pose = pose
        self._velocity = ZERO
        self._now_s = 0.0
        self._command = ZERO
        self._pending: deque[tuple[float, Twist]] = deque()

    def step(self, command: Twist, dt_s: float) -> None:
        """Advance by `dt_s` seconds, along the arc of the mean velocities of that time."""
        self._pending.append((self._now_s + self.settings.delay_s, self._clip(command)))
        # Half a nanosecond forgives the rounding of summed steps.
        while self._pending and self._pending[0][0] <= self._now_s + 0.5e-9:
            self._command = self._pending.popleft()[1]
        self._now_s += dt_s
        before = self._velocity
        share = 1.0 - math.exp(-dt_s / self.settings.lag_s) if self.settings.lag_s > 0 else 1.0
        vx = share * self._command.vx + (1.0 - share) * before.vx
        yaw_rate = share * self._command.yaw_rate + (1.0 - share) * before.yaw_rate
        self._velocity = Twist(vx=vx, yaw_rate=yaw_rate)
        turn = yaw_rate * dt_s
        ahead = vx * dt_s * math.cos(self._pose.pitch)
        at = self._pose
        along = at.yaw + turn / 2
        self._pose = Pose(
            at.x + ahead * math.cos(along),
            at.y + ahead * math.sin(along),
            at.z,
            at.roll,
            at.pitch,
            wrap_angle(at.yaw + turn),
        )

    def place(self, pose: Pose) -> None:
        """Be at `pose`, at the same speed."""
        self._pose = pose

    @property
    def pose(self) -> Pose:
        """Midpoint between the wheels, on the ground."""
        return self._pose

    @property
    def camera_pose(self) -> Pose:
        """Where the mount puts the camera."""
        return self.settings.camera.pose(self._pose)

    @property
    def velocity(self) -> Twist:
        """Forward speed and yaw rate now."""
        return self._velocity

    def _clip(self, command: Twist) -> Twist:
        if not command.is_finite():
            return ZERO
        limits = self.settings
        return Twist(
            vx=max(-limits.backward_m_s, min(limits.forward_m_s, command.vx)),
            yaw_rate=max(-limits.yaw_rate_rad_s, min(limits.yaw_rate_rad_s, command.yaw_rate)),
        )
