"""The simulator's settings: the profile's ``sitl:`` section. Importable without the simulator."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from adatracker_deploy.config.schema import Range
from adatracker_deploy.platform import CameraMount


@dataclass(frozen=True, slots=True, kw_only=True)
class GaitSettings:
    """Camera motion of a trot: in a cycle the trunk bobs and pitches twice and rolls once.

    Two cycles a second is the trot of the Go2's published controllers (a cycle time of 0.5 s). The amplitudes
    are this project's assumption: no figures of the trunk's motion are published; these are what a stride of
    such a length and legs of 0.3 m leave a trunk to do that is not actively levelled.
    """

    slow_hz: Annotated[float, Range(0.2, 6)] = 2.0
    """Cycles a second when it barely walks."""
    fast_hz: Annotated[float, Range(0.2, 6)] = 3.0
    """Cycles a second at its largest speed."""
    bob_m: Annotated[float, Range(0, 0.1)] = 0.012
    """Amplitude up and down, at the largest speed as the next two; standing still there is none."""
    pitch_deg: Annotated[float, Range(0, 15)] = 1.0
    roll_deg: Annotated[float, Range(0, 15)] = 1.5
    uneven_m: Annotated[float, Range(0, 0.2)] = 0.01
    """Standard deviation of the height of the ground under each foot."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SitlSettings:
    """A simulated walking robot that speaks ROS 2 over Zenoh; the policy never sees any of it."""

    camera: CameraMount = field(
        default_factory=lambda: CameraMount(forward_m=0.33, up_m=0.4, pitch_deg=-10.0, fov_deg=100.0)
    )
    """From the point on the ground below the middle of the trunk, which is the body's origin."""
    forward_m_s: Annotated[float, Range(0.1, 5)] = 2.5
    """Largest speeds; commands beyond them are clipped."""
    backward_m_s: Annotated[float, Range(0, 5)] = 1.0
    lateral_m_s: Annotated[float, Range(0, 5)] = 0.6
    yaw_rate_rad_s: Annotated[float, Range(0.1, 6)] = 2.5
    lag_s: Annotated[float, Range(0, 2)] = 0.2
    """Time constant with which the velocities follow their commands."""
    delay_s: Annotated[float, Range(0, 1)] = 0.04
    """From a command to its first effect."""
    slip: Annotated[float, Range(0, 0.5)] = 0.05
    """The share of a step that is lost underfoot: its mean over an episode lies between 0 and twice this."""
    gait: GaitSettings = field(default_factory=GaitSettings)
    battery: Annotated[float, Range(0, 1)] = 0.9
    """State of charge."""
    odometry_hz: Annotated[float, Range(1, 200)] = 50.0
    imu_hz: Annotated[float, Range(1, 200)] = 100.0
