"""The simulator's settings: the profile's ``sitl:`` section. Importable without the simulator."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from adatracker_deploy.config.schema import Range
from adatracker_deploy.platform import CameraMount


@dataclass(frozen=True, slots=True, kw_only=True)
class SitlSettings:
    """A simulated ROS 2 robot on flat ground; the policy never sees any of it."""

    camera: CameraMount = field(default_factory=lambda: CameraMount(forward_m=0.2, up_m=0.6, fov_deg=90.0))
    """From the body's origin, on the ground."""
    forward_m_s: Annotated[float, Range(0, 30)] = 1.5
    """Largest speeds; commands beyond them are clipped."""
    backward_m_s: Annotated[float, Range(0, 30)] = 0.5
    lateral_m_s: Annotated[float, Range(0, 30)] = 0.0
    """0 is a base that cannot move sideways."""
    yaw_rate_rad_s: Annotated[float, Range(0, 10)] = 2.0
    accel_m_s2: Annotated[float, Range(0.05, 50)] = 2.0
    """The fastest that its speeds change, braking included."""
    yaw_accel_rad_s2: Annotated[float, Range(0.05, 100)] = 6.0
    lag_s: Annotated[float, Range(0, 2)] = 0.1
    """Time constant with which the velocities follow their commands."""
    delay_s: Annotated[float, Range(0, 1)] = 0.02
    """From a command to its first effect."""
    slip: Annotated[float, Range(0, 0.5)] = 0.03
    """The largest share of its travel that is lost under the wheels, so that odometry drifts."""
    battery: Annotated[float, Range(0, 1)] = 0.9
    """State of charge."""
    odometry_hz: Annotated[float, Range(1, 200)] = 50.0
    images: Literal["compressed", "raw"] = "compressed"
    """Message type of its camera topic: sensor_msgs/CompressedImage or sensor_msgs/Image."""
