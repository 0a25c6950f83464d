"""The simulator's settings: the profile's ``sitl:`` section. Importable without the simulator."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from adatracker_deploy.config.schema import Range
from adatracker_deploy.platform import CameraMount


@dataclass(frozen=True, slots=True, kw_only=True)
class SitlSettings:
    """A simulated F450 with PX4's dialect; the policy never sees any of it."""

    camera: CameraMount = field(
        default_factory=lambda: CameraMount(forward_m=0.15, up_m=0.1, pitch_deg=20.0, fov_deg=90.0)
    )
    """From the point between the feet of the gear, which is the body's origin."""
    wind_m_s: Annotated[float, Range(0, 12)] = 0.0
    """Mean horizontal wind; its direction is drawn from the seed."""
    gust_m_s: Annotated[float, Range(0, 5)] = 0.0
    """Standard deviation, per axis, of the wind about its mean."""
    velocity_bias_m_s: Annotated[float, Range(0, 0.3)] = 0.1
    """Constant error of the velocity estimate: each axis draws half to all of this, with either sign."""
    velocity_wander_m_s: Annotated[float, Range(0, 0.5)] = 0.12
    """Standard deviation of what comes and goes of that error within some seconds, per axis; with the bias it
    is about 0.2 m/s rms, and at most 0.8 m/s. A real PX4 has 0.1 to 0.4 m/s rms."""
    height_drift_m: Annotated[float, Range(0, 0.5)] = 0.3
    """Standard deviation of the height estimate's slow drift, which is at most 0.7 m."""
    velocity_noise_m_s: Annotated[float, Range(0, 0.5)] = 0.02
    """Standard deviation of the velocity estimate's white noise, per axis."""
    position_noise_m: Annotated[float, Range(0, 1)] = 0.02
    """Standard deviation of the position estimate's white noise, per axis."""
    ekf_ready_s: Annotated[float, Range(0, 30)] = 0.8
    """From power-on until the estimator lets the vehicle arm."""
    landing_detected_s: Annotated[float, Range(0.3, 10)] = 3.0
    """From touching the ground until the land detector tells of it: 1.3 to 5.6 s on a real PX4."""
    tells_current_mode: bool = True
    """CURRENT_MODE, as PX4 has it since 1.15; an older one tells its mode by HEARTBEAT alone, at 1 Hz."""
    battery: Annotated[float, Range(0, 1)] = 1.0
    """State of charge at power-on."""
    yaw_deg: Annotated[float, Range(-180, 180)] = 0.0
    """Heading on the ground at the start, counter-clockwise from east."""
    gcs: str = ""
    """A second MAVLink link, for a ground station: ``udpout:127.0.0.1:14550``; empty for none."""
    parameters: dict[str, float] = field(default_factory=lambda: {"COM_OBL_RC_ACT": 4.0})
    """PX4 parameters changed before power-on; by default a lost offboard link lands the vehicle."""
