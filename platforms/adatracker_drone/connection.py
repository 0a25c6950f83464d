"""How the drone is reached and flown: the profile's ``connection:`` section."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from adatracker_deploy.errors import UsageError
from adatracker_deploy.schema import Range


@dataclass(frozen=True, slots=True, kw_only=True)
class Connection:
    """A PX4 vehicle's address and how it is flown; time-outs are the machine's seconds at any clock speed."""

    url: str = "udpin://127.0.0.1:14540"
    """As MAVSDK takes it, with numeric addresses."""
    system_id: Annotated[int, Range(1, 255)] = 1
    """Of the vehicle to fly (its MAV_SYS_ID); any other on the same link is left alone."""
    takeoff_altitude_m: Annotated[float, Range(1, 30)] = 2.5
    """Above the ground; velocity commands start from there."""
    min_altitude_m: Annotated[float, Range(0.5, 30)] = 1.0
    max_altitude_m: Annotated[float, Range(1, 100)] = 6.0
    """The altitude hold never aims outside this band, whatever is commanded."""
    min_battery: Annotated[float, Range(0, 1)] = 0.3
    """Charge needed to take off; 0 also accepts a vehicle that does not measure it."""
    connect_timeout_s: Annotated[float, Range(1, 120)] = 10.0
    ready_timeout_s: Annotated[float, Range(0, 300)] = 20.0
    """How long the preflight waits for sensors, position and home."""
    telemetry_timeout_s: Annotated[float, Range(0.1, 5)] = 0.3
    """Without a position for this long the drone is flown no further."""

    def __post_init__(self) -> None:
        if not self.min_altitude_m <= self.takeoff_altitude_m <= self.max_altitude_m:
            raise UsageError(
                f"connection: takeoff_altitude_m {self.takeoff_altitude_m:g} is not between min_altitude_m "
                f"{self.min_altitude_m:g} and max_altitude_m {self.max_altitude_m:g}"
            )
