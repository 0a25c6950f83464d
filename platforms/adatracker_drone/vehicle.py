"""A PX4 vehicle behind MAVSDK: what was heard of it, and the few things that can be asked of it.

All of MAVSDK is in this module. Telemetry arrives by subscription in MAVSDK's own thread and replaces a
frozen snapshot; nothing is polled. UDP is `UdpLink`'s, which hands MAVSDK what it lets in and takes from it
what goes out. Set-points go through `MavlinkDirect`, which sends only when it is called: the `Offboard`
plugin repeats the last one from a C++ thread for as long as the process lives, so that the autopilot's
fail-safe for lost set-points cannot see that Python hangs.
"""

from __future__ import annotations

import contextlib
import logging
import math
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import mavsdk
from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk, MavsdkError
from mavsdk.plugins.action import Action
from mavsdk.plugins.mavlink_direct import MavlinkDirect
from mavsdk.plugins.mavlink_direct.mavlink_direct import MavlinkMessage
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import LandedState, StatusTextType, Telemetry

from adatracker_deploy.errors import PlatformError, UsageError
from adatracker_drone.backlog import Backlog
from adatracker_drone.guard import AUTOPILOT_COMPONENT
from adatracker_drone.packets import HEARTBEAT, split
from adatracker_drone.protocol import check_url, dialled, heartbeat_rate_json, offboard_json, set_point_json
from adatracker_drone.signing import Signer, read_key
from adatracker_drone.udp import UdpLink

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from adatracker_deploy.platform import Twist
    from adatracker_deploy.runtime.clock import Clock
    from adatracker_drone.connection import Connection

_log = logging.getLogger(__name__)
_log.addHandler(logging.NullHandler())

_STATUS_RATE_HZ = 5.0
_OURS = "raw://"
"""MAVSDK's name for a connection whose bytes somebody else carries."""
_NO_ANSWER = ("TIMEOUT", "NO_SYSTEM", "CONNECTION_ERROR")
_HEALTH = {
    "is_gyrometer_calibration_ok": "gyroscope",
    "is_accelerometer_calibration_ok": "accelerometer",
    "is_magnetometer_calibration_ok": "magnetometer",
    "is_local_position_ok": "local position",
    "is_global_position_ok": "global position",
    "is_home_position_ok": "home position",
}


@dataclass(frozen=True, slots=True)
class Heard:
    """What the vehicle said last; times are the run's clock at receipt, ns, 0 before the first message."""

    position_t_ns: int = 0
    position_ned_m: tuple[float, float, float] | None = None
    velocity_ned_m_s: tuple[float, float, float] | None = None
    attitude_t_ns: int = 0
    euler_frd_rad: tuple[float, float, float] | None = None
    """Roll, pitch (positive is nose up), heading (clockwise from north)."""
    yaw_rate_frd_rad_s: float = 0.0
    mode: str = ""
    """MAVSDK's name of the flight mode, as the last HEARTBEAT gave it."""
    mode_t_ns: int = 0
    armed: bool = False
    armed_t_ns: int = 0
    landed: bool | None = None
    armable: bool = False
    unhealthy: tuple[str, ...] = tuple(_HEALTH.values())
    """What does not work yet."""
    battery: float | None = None
    """State of charge, 0 to 1."""
    complaint: str = ""
    """The last message of severity warning or worse, in the autopilot's own words."""


class Vehicle:
    """One autopilot over one connection; calls block until it has acknowledged them.

    Args:
        connection: the profile's.
        clock: stamps what is heard.
        on_mode: called in MAVSDK's thread with the name of the mode in every HEARTBEAT; must return at once.

    Raises:
        UsageError: the URL is malformed, its UDP port is taken, or the signing key cannot be used.
    """

    def __init__(self, connection: Connection, clock: Clock, on_mode: Callable[[str], None]) -> None:
        self.heard = Heard()
        self._clock = clock
        self._on_mode = on_mode
        self._system_id = connection.system_id
        self._backlog = Backlog(clock.speed)
        self._link = _udp_link(connection, self._pass_on)
        mavsdk.log_subscribe(_to_logging)
        configuration = Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER)
        self._mavsdk = Mavsdk(configuration)
        if self._link is not None:
            self._mavsdk.subscribe_raw_bytes_to_be_sent(self._link.send)
        result = self._mavsdk.add_any_connection(connection.url if self._link is None else _OURS)
        if result != ConnectionResult.SUCCESS:
            self.close()
            raise UsageError(
                f"connection.url {connection.url!r} cannot be opened ({result.name}): "
                "check the address and who uses it"
            )
        if self._link is not None:
            self._link.start()

    @property
    def ignored(self) -> str:
        """What the link ignored because it was not the autopilot's; empty where nothing was."""
        return self._link.guard.offences if self._link is not None else ""

    def take_notices(self) -> tuple[str, ...]:
        """Return what the link has to tell since the last call."""
        return self._link.guard.take_notices() if self._link is not None else ()

    def discover(self) -> bool:
        """Return whether this vehicle's autopilot has been heard, and from then on listen to it."""
        for system in self._mavsdk.get_systems():
            if system.get_system_id() == self._system_id and system.has_autopilot():
                self._listen(system)
                return True
        return False

    def send_velocity(self, command: Twist, now_ns: int) -> None:
        """Send one set-point, once; does not wait for anything.

        Raises:
            PlatformError: `command` is not a velocity that a drone can fly; nothing was sent.
        """
        fields = set_point_json(command, now_ns, self._autopilot)
        with self._explained("send a set-point"):
            self._direct.send_message(self._message("SET_POSITION_TARGET_LOCAL_NED", fields))

    def switch_to_offboard(self) -> None:
        """Ask for OFFBOARD; the proof is the mode that is heard, not the answer."""
        with self._explained("switch to OFFBOARD"):
            self._direct.send_command(self._message("COMMAND_LONG", offboard_json(self._autopilot)))

    def arm(self) -> None:
        """Arm; the autopilot refuses when its own checks fail."""
        with self._explained("arm"):
            self._action.arm()

    def take_off(self, altitude_m: float) -> None:
        """Start to climb to `altitude_m` above the ground, as the autopilot does it."""
        with self._explained("take off"):
            self._action.set_takeoff_altitude(altitude_m)
            self._action.takeoff()

    def hold(self) -> None:
        """Switch to HOLD: stop and hover."""
        with self._explained("hold"):
            self._action.hold()

    def land(self) -> None:
        """Switch to LAND: come down here, and disarm on the ground."""
        with self._explained("land"):
            self._action.land()

    def parameter(self, name: str, kind: type[int] | type[float]) -> float | None:
        """Return a parameter of PX4's, or None when this autopilot does not have it."""
        try:
            if kind is int:
                return float(self._param.get_param_int(name))
            return float(self._param.get_param_float(name))
        except MavsdkError as error:
            _log.debug("parameter %s: %s", name, error)
            return None

    def close(self) -> None:
        """Release the connection; leaves no thread behind."""
        if self._link is not None:
            self._link.close()
        self._mavsdk.destroy()

    def _pass_on(self, frames: bytes) -> None:
        """Hand MAVSDK what the link has let in, unless it is behind: what is old by then is better lost."""
        heartbeats = sum(packet.message == HEARTBEAT for packet in split(frames))
        if self._backlog.takes(heartbeats, time.monotonic()):
            self._mavsdk.pass_received_raw_bytes(frames)

    def _listen(self, system: Any) -> None:
        self._autopilot = (system.get_system_id(), AUTOPILOT_COMPONENT)
        self._action, self._param = Action(system), Param(system)
        self._direct, self._telemetry = MavlinkDirect(system), Telemetry(system)
        self._telemetry.subscribe_position_velocity_ned(self._on_position)
        self._telemetry.subscribe_attitude_euler(self._on_attitude)
        self._telemetry.subscribe_attitude_angular_velocity_body(self._on_angular_velocity)
        self._telemetry.subscribe_flight_mode(self._on_flight_mode)
        self._backlog.begin(time.monotonic())
        self._telemetry.subscribe_armed(
            lambda armed, _: self._hear(armed=armed, armed_t_ns=self._clock.now_ns())
        )
        self._telemetry.subscribe_landed_state(
            lambda state, _: self._hear(landed=state == LandedState.ON_GROUND)
        )
        self._telemetry.subscribe_health(self._on_health)
        self._telemetry.subscribe_battery(self._on_battery)
        self._telemetry.subscribe_status_text(self._on_status_text)
        self._ask_for_rates()

    def _ask_for_rates(self) -> None:
        """Hear of a new mode and of landing within 0.2 s; an autopilot that refuses tells them at 1 Hz."""
        with contextlib.suppress(MavsdkError):
            self._direct.send_command(
                self._message("COMMAND_LONG", heartbeat_rate_json(_STATUS_RATE_HZ, self._autopilot))
            )
            self._telemetry.set_rate_landed_state(_STATUS_RATE_HZ)

    def _message(self, name: str, fields: str) -> Any:
        system, component = self._autopilot
        return MavlinkMessage(
            message_name=name,
            target_system_id=system,
            target_component_id=component,
            fields_json=fields,
        )

    def _hear(self, **news: Any) -> None:
        """Replace the snapshot; MAVSDK calls from one thread only, so no news is lost."""
        self.heard = replace(self.heard, **news)

    def _on_position(self, data: Any, _: Any) -> None:
        position = (data.position.north_m, data.position.east_m, data.position.down_m)
        velocity = (data.velocity.north_m_s, data.velocity.east_m_s, data.velocity.down_m_s)
        if all(map(math.isfinite, position + velocity)):
            self._hear(position_t_ns=self._clock.now_ns(), position_ned_m=position, velocity_ned_m_s=velocity)

    def _on_attitude(self, data: Any, _: Any) -> None:
        euler = tuple(map(math.radians, (data.roll_deg, data.pitch_deg, data.yaw_deg)))
        if all(map(math.isfinite, euler)):
            self._hear(attitude_t_ns=self._clock.now_ns(), euler_frd_rad=euler)

    def _on_angular_velocity(self, data: Any, _: Any) -> None:
        if math.isfinite(data.yaw_rad_s):
            self._hear(yaw_rate_frd_rad_s=data.yaw_rad_s)

    def _on_flight_mode(self, mode: Any, _: Any) -> None:
        self._backlog.tell(time.monotonic())
        self._hear(mode=mode.name, mode_t_ns=self._clock.now_ns())
        self._on_mode(mode.name)

    def _on_health(self, health: Any, _: Any) -> None:
        self._hear(
            armable=health.is_armable,
            unhealthy=tuple(name for flag, name in _HEALTH.items() if not getattr(health, flag)),
        )

    def _on_battery(self, battery: Any, _: Any) -> None:
        percent = battery.remaining_percent
        self._hear(battery=percent / 100 if 0 <= percent <= 100 else None)

    def _on_status_text(self, status: Any, _: Any) -> None:
        if status.type >= StatusTextType.WARNING:
            self._hear(complaint=status.text)

    @contextlib.contextmanager
    def _explained(self, what: str) -> Iterator[None]:
        try:
            yield
        except MavsdkError as error:
            result = getattr(getattr(error, "result", None), "name", str(error))
            if result in _NO_ANSWER:
                raise PlatformError(
                    f"no answer from the autopilot when asked to {what} ({result}): its own fail-safe acts; "
                    "be ready with the remote control"
                ) from error
            complaint = self.heard.complaint
            why = f"; its last warning: {complaint}" if complaint else ""
            raise PlatformError(f"the autopilot did not {what}: {result}{why}") from error


def _udp_link(connection: Connection, hear: Callable[[bytes], None]) -> UdpLink | None:
    """Open the link where it is UDP; on a cable or a TCP connection of its own MAVSDK does without."""
    bound = check_url(connection.url)
    address = bound or dialled(connection.url)
    if address is None:
        return None
    signer = Signer(read_key(connection.signing_key)) if connection.signing_key else None
    return UdpLink(address, connection.system_id, signer, hear, binds=bound is not None)


def _to_logging(level: Any, message: str, _file: str | None, _line: int) -> bool:
    """Keep MAVSDK off stdout: its lines go to `logging`, under this module's name."""
    _log.log(10 * (int(level) + 1), "%s", message)
    return True
