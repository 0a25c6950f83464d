"""Ground bodies: their interface to the world, building blocks, and a reusable differential drive."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Annotated, Protocol

from adatracker_deploy.config.schema import Range
from adatracker_deploy.core.geometry import Pose, wrap_angle
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_deploy.platform import Body, CameraMount


class GroundBody(Body):
    """A body on the ground: it follows the terrain and is stopped by obstacles."""

    _pose = Pose()

    def place(self, pose: Pose) -> None:
        """Move the body to `pose`; velocity and all other state stay unchanged."""
        self._pose = pose

    @property
    def pose(self) -> Pose:
        """Return the pose of the body's origin, on the ground."""
        return self._pose


class DelayLine:
    """Delays commands by `delay_s`; zero before the first."""

    def __init__(self, delay_s: float) -> None:
        self._delay_s = delay_s
        self._now_s = 0.0
        self._command = ZERO
        self._pending: deque[tuple[float, Twist]] = deque()

    def give(self, command: Twist) -> None:
        """Add a command now."""
        self._pending.append((self._now_s + self._delay_s, command))

    def advance(self, dt_s: float) -> Twist:
        """Return the command in effect for the next `dt_s` seconds."""
        # Half a nanosecond tolerates the rounding of summed steps.
        while self._pending and self._pending[0][0] <= self._now_s + 0.5e-9:
            self._command = self._pending.popleft()[1]
        self._now_s += dt_s
        return self._command


def lag_share(lag_s: float, dt_s: float) -> float:
    """Return the share of a difference that a first-order lag closes in `dt_s`; 1 without a lag."""
    return 1.0 - math.exp(-dt_s / lag_s) if lag_s > 0 else 1.0


def along_arc(at: Pose, velocity: Twist, dt_s: float) -> Pose:
    """Return the pose reached from `at` with a body-frame `velocity`, along its arc and the local slope."""
    turn = velocity.yaw_rate * dt_s
    along = at.yaw + turn / 2
    ahead, aside = velocity.vx * dt_s * math.cos(at.pitch), velocity.vy * dt_s * math.cos(at.roll)
    return Pose(
        at.x + ahead * math.cos(along) - aside * math.sin(along),
        at.y + ahead * math.sin(along) + aside * math.cos(along),
        at.z,
        at.roll,
        at.pitch,
        wrap_angle(at.yaw + turn),
    )


def within(value: float, magnitude: float) -> float:
    """Return `value`, clipped to [-magnitude, magnitude]."""
    return max(-magnitude, min(magnitude, value))


class _Speeds(Protocol):
    @property
    def forward_m_s(self) -> float: ...
    @property
    def backward_m_s(self) -> float: ...
    @property
    def yaw_rate_rad_s(self) -> float: ...


def clipped(command: Twist, largest: _Speeds, lateral_m_s: float = 0.0) -> Twist:
    """Return `command` within a ground body's largest speeds, ZERO if it is not finite."""
    if not command.is_finite():
        return ZERO
    return Twist(
        vx=max(-largest.backward_m_s, min(largest.forward_m_s, command.vx)),
        vy=within(command.vy, lateral_m_s),
        yaw_rate=within(command.yaw_rate, largest.yaw_rate_rad_s),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveSettings:
    """Parameters of a differential drive."""

    camera: CameraMount = field(default_factory=CameraMount)
    forward_m_s: Annotated[float, Range(0, 30)] = 1.5
    """Largest speed forward; commands beyond a limit are clipped."""
    backward_m_s: Annotated[float, Range(0, 30)] = 0.5
    yaw_rate_rad_s: Annotated[float, Range(0, 10)] = 2.0
    lag_s: Annotated[float, Range(0, 2)] = 0.0
    """Time constant with which both velocities follow their commands; 0 follows at once."""
    delay_s: Annotated[float, Range(0, 2)] = 0.0
    """Time from a command to its first effect."""


class KinematicBody(GroundBody):
    """A differential drive: forward speed and yaw rate follow their commands by a first-order lag.

    Lateral and vertical commands are ignored. A command that is not finite counts as zero, as in the gate.
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
        self._delay = DelayLine(self.settings.delay_s)

    def step(self, command: Twist, dt_s: float) -> None:
        """Advance by `dt_s` seconds, along the arc of the mean velocities of that time."""
        self._delay.give(clipped(command, self.settings))
        wanted, before = self._delay.advance(dt_s), self._velocity
        share = lag_share(self.settings.lag_s, dt_s)
        vx = share * wanted.vx + (1.0 - share) * before.vx
        yaw_rate = share * wanted.yaw_rate + (1.0 - share) * before.yaw_rate
        self._velocity = Twist(vx=vx, yaw_rate=yaw_rate)
        self._pose = along_arc(self._pose, self._velocity, dt_s)

    @property
    def camera_pose(self) -> Pose:
        """Return the camera's pose on its mount."""
        return self.settings.camera.pose(self._pose)

    @property
    def velocity(self) -> Twist:
        """Return the current forward speed and yaw rate."""
        return self._velocity
