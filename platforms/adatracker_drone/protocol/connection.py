"""The profile's ``connection:`` section: how the drone is reached and flown."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.config.schema import Range
from adatracker_deploy.core.errors import UsageError
from adatracker_drone.protocol.setpoints import numeric_address

_UID = re.compile(r"[0-9a-f]{36}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Connection:
    """A PX4 vehicle's address and how it is flown; time-outs are the machine's seconds at any clock speed."""

    url: str = "udpin://127.0.0.1:14540"
    """As MAVSDK takes it, with numeric addresses."""
    system_id: Annotated[int, Range(1, 255)] = 1
    """MAV_SYS_ID of the vehicle to fly; any other on the same link is ignored."""
    signing_key: str = ""
    """A file of 32 secret bytes, mode 0600, that the autopilot has too: then every packet is signed, and none
    without a valid signature is listened to. Empty signs nothing. Only where `url` is UDP."""
    peer: str = ""
    """The one address and port that is listened and spoken to, such as 192.168.1.10:14580. Empty leaves it to
    the first HEARTBEAT of `system_id`. Only where `url` is ``udpin://``."""
    uid: str = ""
    """The autopilot's own number (AUTOPILOT_VERSION, uid2), 36 hexadecimal digits: no other is flown. Empty
    flies any."""
    alone: bool = False
    """Nobody else may be heard on the link: that keeps the drone from being armed, and ends a flight."""
    takeoff_altitude_m: Annotated[float, Range(1, 30)] = 2.5
    """Above the ground; velocity commands start from there."""
    min_battery: Annotated[float, Range(0, 1)] = 0.3
    """Charge needed to take off; 0 also accepts a vehicle that does not measure it."""
    connect_timeout_s: Annotated[float, Range(1, 120)] = 10.0
    ready_timeout_s: Annotated[float, Range(0, 300)] = 20.0
    """Time for which the preflight waits for sensors, position and home."""
    telemetry_timeout_s: Annotated[float, Range(0.1, 5)] = 0.27
    """Without a position for this long the drone is flown no further."""

    @property
    def robot(self) -> str:
        """Name the autopilot's link: the same in every run on this machine that would reach it."""
        return f"mavlink:{self.url}:{self.system_id}"

    def __post_init__(self) -> None:
        if self.signing_key and not self.url.startswith("udp"):
            raise UsageError(
                f"connection: signing_key needs a udpin:// or udpout:// url, not {self.url!r}: MAVSDK, which "
                "carries the others, signs nothing"
            )
        if self.peer:
            numeric_address(self.peer)
            if not self.url.startswith("udpin:"):
                raise UsageError(f"connection: peer needs a udpin:// url, not {self.url!r}: it waits for one")
        if self.uid and not _UID.fullmatch(self.uid):
            raise UsageError(
                f"connection: uid {self.uid!r}: expected 36 hexadecimal digits, in small letters"
            )


def altitude_band(connection: Connection, limits: Limits) -> tuple[float, float]:
    """Return the band that the altitude hold aims inside of, whatever is commanded: the gate's.

    Raises:
        UsageError: there is none, or taking off would leave it.
    """
    if limits.altitude_m is None:
        raise UsageError(
            "limits: missing key 'altitude_m': a drone needs a band of altitudes, such as [1, 6]"
        )
    low, high = limits.altitude_m
    if not low <= connection.takeoff_altitude_m <= high:
        raise UsageError(
            f"connection: takeoff_altitude_m {connection.takeoff_altitude_m:g} is not inside limits: "
            f"altitude_m [{low:g}, {high:g}]"
        )
    return low, high
