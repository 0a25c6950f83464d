"""A robot body as varied in learning: camera pose, speed limits, lag and delay."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Annotated, Literal

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.config.schema import Range
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.platform import Body, CameraMount
from adatracker_deploy.registry import load_platform, load_profile, platform_names
from adatracker_deploy.sim.bodies import DriveSettings, KinematicBody

BodyKind = Literal["differential", "quadruped", "drone"]

DRONE_LAG_S, DRONE_DELAY_S = 0.3, 0.2
"""Lag and delay closest to the simulated drone's: of 12 pairs tried, the expert follows with these as well
as with any, and they lie near its step response (half of a step of 2 m/s after 0.55 s, all after 1.5 s)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Embodiment:
    """The parameters that a policy must infer; by default the body Offline EVT was trained on."""

    kind: BodyKind = "differential"
    height_m: Annotated[float, Range(0.05, 10)] = 1.7
    """Height of the camera above the ground."""
    pitch_deg: Annotated[float, Range(-90, 90)] = 0.0
    """Pitch of the camera; positive looks down."""
    fov_deg: Annotated[float, Range(20, 150)] = 90.0
    """Horizontal."""
    aspect: Annotated[float, Range(0.25, 1)] = 1.0
    """Height of a picture as a share of its width; policies are shown it in the middle of a square."""
    forward_m_s: Annotated[float, Range(0.05, 30)] = 1.3
    backward_m_s: Annotated[float, Range(0, 30)] = 1.3
    yaw_rate_rad_s: Annotated[float, Range(0.05, 10)] = math.radians(120.0)
    lag_s: Annotated[float, Range(0, 2)] = 0.0
    """Time constant of the velocities; a drone has its own dynamics, which this only describes
    (`DRONE_LAG_S`)."""
    delay_s: Annotated[float, Range(0, 2)] = 0.0
    """From a command to its first effect; as for `lag_s`, not imposed on a drone."""

    def limits(self) -> Limits:
        """Return the speeds for an action of 1; accelerations are left to the body's lag."""
        return Limits(
            forward_m_s=self.forward_m_s,
            backward_m_s=self.backward_m_s,
            yaw_rate_rad_s=self.yaw_rate_rad_s,
            accel_m_s2=50.0,
            yaw_accel_rad_s2=100.0,
        )

    def body(self) -> Body:
        """Return the dynamics for an in-process world.

        Raises:
            UsageError: it is a drone, and that robot or its simulation is not installed.
        """
        if self.kind == "drone":
            return Hovering(_drone(self), self.height_m)
        drive = DriveSettings(
            camera=CameraMount(up_m=self.height_m, pitch_deg=self.pitch_deg, fov_deg=self.fov_deg),
            forward_m_s=self.forward_m_s,
            backward_m_s=self.backward_m_s,
            yaw_rate_rad_s=self.yaw_rate_rad_s,
            lag_s=self.lag_s,
            delay_s=self.delay_s,
        )
        return KinematicBody(drive) if self.kind == "differential" else SwayingBody(drive)


class SwayingBody(KinematicBody):
    """A differential drive whose camera moves as on a trotting robot: it bobs and pitches at every footfall.

    Amplitudes and stride rates are those of small quadrupeds at a trot, rounded; they grow with the speed up
    to `_WHOLE_SWAY_M_S`.
    """

    _BOB_M = 0.015
    _PITCH_RAD = math.radians(1.5)
    _ROLL_RAD = math.radians(2.0)
    _STRIDES_HZ = (1.5, 3.0)
    """Standing start, and at the largest speed."""
    _WHOLE_SWAY_M_S = 0.5

    def reset(self, pose: Pose, seed: int) -> None:
        """Stand still at `pose`, somewhere in the cycle of the gait."""
        super().reset(pose, seed)
        self._phase_rad = float(seed % 97) / 97 * math.tau

    def step(self, command: Twist, dt_s: float) -> None:
        """Advance by `dt_s` seconds."""
        super().step(command, dt_s)
        slow, fast = self._STRIDES_HZ
        pace = min(1.0, self._speed_m_s() / max(self.settings.forward_m_s, 1e-3))
        self._phase_rad = (self._phase_rad + math.tau * dt_s * (slow + (fast - slow) * pace)) % math.tau

    @property
    def camera_pose(self) -> Pose:
        """Pose of the camera in its mount, moved by the gait: two footfalls a stride, one roll."""
        share = min(1.0, self._speed_m_s() / self._WHOLE_SWAY_M_S)
        sway = Pose(
            z=-share * self._BOB_M * math.cos(2 * self._phase_rad),
            roll=share * self._ROLL_RAD * math.sin(self._phase_rad),
            pitch=share * self._PITCH_RAD * math.sin(2 * self._phase_rad),
        )
        return self.settings.camera.pose(self.pose @ sway)

    def _speed_m_s(self) -> float:
        """Return how fast the feet go; half a metre from the middle, turning is walking too."""
        return abs(self.velocity.vx) + 0.5 * abs(self.velocity.yaw_rate)


class Hovering(Body):
    """A flying body that starts at a height and keeps it, as an autopilot's altitude hold does."""

    _CLIMB_PER_S = 1.0
    _MOST_CLIMB_M_S = 1.0

    def __init__(self, body: Body, height_m: float) -> None:
        self._body = body
        self._height_m = height_m
        self._ground_m = 0.0

    def reset(self, pose: Pose, seed: int) -> None:
        """Hover over `pose`, which is on the ground."""
        self._ground_m = pose.z
        self._body.reset(dataclasses.replace(pose, z=pose.z + self._height_m, roll=0.0, pitch=0.0), seed)

    def step(self, command: Twist, dt_s: float) -> None:
        """Advance by `dt_s` seconds; the command's vertical speed is the altitude hold's."""
        lack = self._ground_m + self._height_m - self._body.pose.z
        climb = max(-self._MOST_CLIMB_M_S, min(self._MOST_CLIMB_M_S, self._CLIMB_PER_S * lack))
        self._body.step(dataclasses.replace(command, vz=climb), dt_s)

    @property
    def pose(self) -> Pose:
        """Return the flying body's pose."""
        return self._body.pose

    @property
    def camera_pose(self) -> Pose:
        """Return the pose of the flying body's camera."""
        return self._body.camera_pose

    @property
    def velocity(self) -> Twist:
        """Return the flying body's velocity."""
        return self._body.velocity


def _drone(embodiment: Embodiment) -> Body:
    if "drone" not in platform_names():
        raise UsageError("a drone's body needs the robot package adatracker_drone, which is not installed")
    platform = load_platform("drone")
    profile = load_profile(platform.default_profile, platform)
    mount = CameraMount(pitch_deg=embodiment.pitch_deg, fov_deg=embodiment.fov_deg)
    return platform.body(dataclasses.replace(profile, sitl=dataclasses.replace(profile.sitl, camera=mount)))
