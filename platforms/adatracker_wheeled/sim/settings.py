"""The simulator's settings: the profile's ``sitl:`` section. Importable without the simulator."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from adatracker_deploy.config.schema import Range
from adatracker_deploy.platform import CameraMount

FaultName = Literal[
    "remote", "emergency_stop", "fault", "silence", "frozen_feedback", "frozen_state", "low_battery"
]
"""Faults that can be injected; `sim.faults` describes each, and how to begin and end it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SitlSettings:
    """A simulated base on flat ground; the policy never sees any of it."""

    camera: CameraMount = field(default_factory=lambda: CameraMount(forward_m=0.2, up_m=0.6, fov_deg=90.0))
    """From the midpoint between the wheels, on the ground."""
    forward_m_s: Annotated[float, Range(0, 30)] = 1.5
    """The fastest it goes; commands beyond are clipped by the base."""
    backward_m_s: Annotated[float, Range(0, 30)] = 1.5
    yaw_rate_rad_s: Annotated[float, Range(0, 10)] = 2.0
    accel_m_s2: Annotated[float, Range(0.05, 50)] = 2.0
    """The fastest that its forward speed changes, braking included."""
    yaw_accel_rad_s2: Annotated[float, Range(0.05, 100)] = 6.0
    lag_s: Annotated[float, Range(0, 2)] = 0.1
    """Time constant with which both velocities follow their commands."""
    delay_s: Annotated[float, Range(0, 1)] = 0.02
    """From a command to its first effect."""
    slip: Annotated[float, Range(0, 0.5)] = 0.03
    """The largest share of a wheel's travel that is lost; each side draws its own, so odometry drifts."""
    battery: Annotated[float, Range(0, 1)] = 0.9
    """State of charge at power-on."""
    faults: tuple[FaultName, ...] = ()
    """Faults that are on from the start."""
