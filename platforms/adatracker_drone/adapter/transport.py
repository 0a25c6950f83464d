"""Transport to a PX4 vehicle through MAVSDK: telemetry snapshot, set-points, commands and parameters.

All of MAVSDK is in this module. Telemetry arrives by subscription in MAVSDK's own thread and replaces a
frozen snapshot; nothing is polled. `UdpLink` owns UDP: it passes accepted datagrams to MAVSDK and sends
MAVSDK's. Set-points and commands go through `MavlinkDirect`, which sends only when called. MAVSDK's own
plugins repeat. `Offboard` repeats the last set-point from a C++ thread while the process lives, so the
autopilot's fail-safe cannot notice that Python hangs; `Action` repeats a command whose answer was lost, so a
take-off could follow a stop's LAND. They also block up to 2 s for an answer; here only parameters block.
"""

from __future__ import annotations

import contextlib
import json
import logging
import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import mavsdk
from mavsdk import Autopilot, ComponentType, Configuration, ConnectionResult, Mavsdk, MavsdkError
from mavsdk.plugins.mavlink_direct import MavlinkDirect
from mavsdk.plugins.mavlink_direct.mavlink_direct import MavlinkMessage
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import StatusTextType, Telemetry

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_drone.adapter.backlog import Backlog
from adatracker_drone.adapter.commands import TELL_VERSION, VehicleCommand, rates
from adatracker_drone.adapter.sender_filter import AUTOPILOT_COMPONENT, Ignored
from adatracker_drone.adapter.udp import UdpLink
from adatracker_drone.adapter.vehicle_state import HEALTH, Landed, VehicleState, mode_name
from adatracker_drone.protocol.events import NO_REASON, WARNING, number_of, reason_of
from adatracker_drone.protocol.packets import HEARTBEAT, split
from adatracker_drone.protocol.setpoints import check_url, dialled, numeric_address, set_point_json
from adatracker_drone.protocol.signing import Signer, read_key

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.messages import Twist
    from adatracker_drone.protocol.connection import Connection

_log = logging.getLogger(__name__)
_log.addHandler(logging.NullHandler())

_STATUS_RATE_HZ = 20.0
"""Requested rate of CURRENT_MODE and EXTENDED_SYS_STATE; a real PX4 then reported new modes after 8 to 63
ms."""
_ARDUPILOT = (
    "the autopilot is ArduPilot (by its HEARTBEAT), not PX4: its modes, fail-safes and parameters differ, so "
    "no stop and no check would mean the same; fly PX4, or add a robot of your own (docs/add-a-robot.md)"
)
_OURS = "raw://"
"""MAVSDK's name for a connection whose bytes the application carries."""
_ARMED = 128
"""MAV_MODE_FLAG_SAFETY_ARMED."""
_ACCEPTED, _IN_PROGRESS = 0, 5
_RESULTS = ("accepted", "TEMPORARILY_REJECTED", "DENIED", "UNSUPPORTED", "FAILED", "IN_PROGRESS", "CANCELLED")
"""MAV_RESULT."""


class Answer(NamedTuple):
    """The autopilot's answers to one kind of command."""

    number: int = 0
    """Answers so far."""
    result: int = _ACCEPTED
    """Result of the last answer."""

    @property
    def accepted(self) -> bool:
        """Whether the command was accepted."""
        return self.result in (_ACCEPTED, _IN_PROGRESS)

    @property
    def says(self) -> str:
        """MAVLink's name of the result."""
        return _RESULTS[self.result] if self.result < len(_RESULTS) else f"result {self.result}"


class Vehicle:
    """One autopilot over one connection.

    Args:
        connection: the profile's.
        clock: stamps what is heard.
        on_mode: called in MAVSDK's thread with the mode in every CURRENT_MODE and HEARTBEAT; must return at
            once.

    Raises:
        UsageError: the URL is malformed, its UDP port is taken, or the signing key cannot be used.
    """

    def __init__(self, connection: Connection, clock: Clock, on_mode: Callable[[str], None]) -> None:
        self.heard = VehicleState()
        self.is_px4: bool | None = None
        """None until an autopilot is heard."""
        self._clock = clock
        self._on_mode = on_mode
        self._system_id = connection.system_id
        self._backlog = Backlog(clock.speed)
        self._answers: dict[int, Answer] = {}
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
        """Describe ignored messages that were not the autopilot's; empty without any."""
        return self._link.guard.offences if self._link is not None else ""

    def take_notices(self) -> tuple[str, ...]:
        """Return the link's new notices since the last call."""
        return self._link.guard.take_notices() if self._link is not None else ()

    @property
    def foreign_datagrams(self) -> int:
        """Number of datagrams from other addresses than the autopilot's."""
        return self._link.guard.ignored[Ignored.STRANGER] if self._link is not None else 0

    def discover(self) -> bool:
        """Return whether this vehicle's autopilot has been heard, and from then on listen to it.

        Raises:
            PlatformError: its HEARTBEAT says that it is ArduPilot; it is asked for nothing.
        """
        for system in self._mavsdk.get_systems():
            if system.get_system_id() != self._system_id or not system.has_autopilot():
                continue
            kind = system.autopilot_type()
            if kind is Autopilot.ARDUPILOT:
                raise PlatformError(_ARDUPILOT)
            self.is_px4 = kind is Autopilot.PX4
            if self.is_px4:  # for a moment MAVSDK takes every autopilot for a generic one
                self._listen(system)
                return True
        return False

    def send_velocity(self, command: Twist, now_ns: int) -> None:
        """Send one set-point, once; does not wait for anything.

        Raises:
            PlatformError: `command` is not a velocity that a drone can fly; nothing was sent.
        """
        fields = set_point_json(command, now_ns, self._autopilot)
        with self._explained("follow a set-point"):
            self._direct.send_message(self._message("SET_POSITION_TARGET_LOCAL_NED", fields))

    def order(self, order: VehicleCommand) -> None:
        """Send an order once; does not wait for anything."""
        with self._explained(order.says):
            self._direct.send_message(self._message("COMMAND_LONG", order.to_json(*self._autopilot)))

    def answer(self, order: VehicleCommand) -> Answer:
        """Return what was answered to this kind of order. PX4 answers a switch of modes twice."""
        return self._answers.get(order.command, Answer())

    def set_takeoff_altitude(self, altitude_m: float) -> None:
        """Set how high above the ground a take-off ends; moves nothing, and blocks until it is answered."""
        with self._explained("take its take-off height (MIS_TAKEOFF_ALT)"):
            self._param.set_param_float("MIS_TAKEOFF_ALT", altitude_m)

    def parameter(self, name: str, kind: type[int] | type[float]) -> float | None:
        """Return a parameter of PX4's, or None when this autopilot does not have it."""
        try:
            if kind is int:
                return float(self._param.get_param_int(name))
            return float(self._param.get_param_float(name))
        except MavsdkError as error:
            _log.debug("parameter %s: %s", name, error)
            return None

    def set_parameter(self, name: str, value: float, kind: type[int] | type[float]) -> None:
        """Write a parameter of PX4's; blocks until it is answered."""
        with self._explained(f"set {name} to {value:g}"):
            if kind is int:
                self._param.set_param_int(name, int(value))
            else:
                self._param.set_param_float(name, value)

    def close(self) -> None:
        """Release the connection; leaves no thread behind."""
        if self._link is not None:
            self._link.close()
        self._mavsdk.destroy()

    def _pass_on(self, frames: bytes) -> None:
        """Pass accepted datagrams to MAVSDK; drop them if it is behind, because they would be old on
        delivery."""
        heartbeats = sum(packet.message == HEARTBEAT for packet in split(frames))
        if self._backlog.takes(heartbeats, time.monotonic()):
            self._mavsdk.pass_received_raw_bytes(frames)

    def _listen(self, system: Any) -> None:
        self._autopilot = (system.get_system_id(), AUTOPILOT_COMPONENT)
        self._direct, self._param = MavlinkDirect(system), Param(system)
        self._telemetry = Telemetry(system)
        for name, hear in (
            ("CURRENT_MODE", self._on_current_mode),
            ("HEARTBEAT", self._on_heartbeat),
            ("EXTENDED_SYS_STATE", self._on_extended_sys_state),
            ("COMMAND_ACK", self._on_answer),
            ("AUTOPILOT_VERSION", self._on_version),
            ("EVENT", self._on_event),
        ):
            self._direct.subscribe_message(name, self._of_the_autopilot, hear)
        self._backlog.begin(time.monotonic())
        self._telemetry.subscribe_position_velocity_ned(self._on_position)
        self._telemetry.subscribe_attitude_euler(self._on_attitude)
        self._telemetry.subscribe_attitude_angular_velocity_body(self._on_angular_velocity)
        self._telemetry.subscribe_health(self._on_health)
        self._telemetry.subscribe_battery(self._on_battery)
        self._telemetry.subscribe_status_text(self._on_status_text)
        for order in (TELL_VERSION, *rates(_STATUS_RATE_HZ)):
            self.order(order)

    def _of_the_autopilot(self, message: Any, hear: Callable[[dict[str, Any]], None]) -> None:
        if (message.system_id, message.component_id) == self._autopilot:
            hear(json.loads(message.fields_json))

    def _message(self, name: str, fields: str) -> Any:
        system, component = self._autopilot
        return MavlinkMessage(
            message_name=name,
            target_system_id=system,
            target_component_id=component,
            fields_json=fields,
        )

    def _hear(self, **news: Any) -> None:
        """Replace the snapshot; MAVSDK calls from one thread only, so no update is lost."""
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

    def _on_current_mode(self, told: dict[str, Any]) -> None:
        self._hear(tells_current_mode=True)
        self._hear_mode(told["custom_mode"])

    def _on_heartbeat(self, told: dict[str, Any]) -> None:
        self._backlog.tell(time.monotonic())
        self._hear(armed=bool(told["base_mode"] & _ARMED), armed_t_ns=self._clock.now_ns())
        self._hear_mode(told["custom_mode"])

    def _hear_mode(self, custom_mode: int) -> None:
        mode = mode_name(custom_mode)
        self._hear(mode=mode, mode_t_ns=self._clock.now_ns())
        self._on_mode(mode)

    def _on_extended_sys_state(self, told: dict[str, Any]) -> None:
        with contextlib.suppress(ValueError):  # an invalid number changes nothing
            self._hear(landed=Landed(told["landed_state"]))

    def _on_answer(self, told: dict[str, Any]) -> None:
        before = self._answers.get(told["command"], Answer())
        self._answers[told["command"]] = Answer(before.number + 1, told["result"])

    def _on_version(self, told: dict[str, Any]) -> None:
        self._hear(uid=bytes(told["uid2"]).hex())

    def _on_event(self, told: dict[str, Any]) -> None:
        says_more = told["id"] != number_of(NO_REASON) or not self.heard.complaint
        if told["log_levels"] & 0xF <= WARNING and says_more:
            self._hear(complaint=reason_of(told["id"]))

    def _on_health(self, health: Any, _: Any) -> None:
        self._hear(
            armable=health.is_armable,
            unhealthy=tuple(name for flag, name in HEALTH.items() if not getattr(health, flag)),
        )

    def _on_battery(self, battery: Any, _: Any) -> None:
        percent = battery.remaining_percent
        charge = percent / 100 if 0 <= percent <= 100 else None
        self._hear(battery=charge, battery_t_ns=self._clock.now_ns())

    def _on_status_text(self, status: Any, _: Any) -> None:
        if status.type >= StatusTextType.WARNING:
            self._hear(complaint=status.text)

    @contextlib.contextmanager
    def _explained(self, what: str) -> Iterator[None]:
        try:
            yield
        except MavsdkError as error:
            result = getattr(getattr(error, "result", None), "name", str(error))
            raise PlatformError(f"the autopilot could not be asked to {what} ({result})") from error


def _udp_link(connection: Connection, hear: Callable[[bytes], None]) -> UdpLink | None:
    """Open the link where it is UDP; on a cable or a TCP connection of its own MAVSDK does without."""
    bound = check_url(connection.url)
    address = bound or dialled(connection.url)
    if address is None:
        return None
    signer = Signer(read_key(connection.signing_key)) if connection.signing_key else None
    peer = numeric_address(connection.peer) if connection.peer else None
    return UdpLink(address, connection.system_id, signer, hear, binds=bound is not None, peer=peer)


def _to_logging(level: Any, message: str, _file: str | None, _line: int) -> bool:
    """Keep MAVSDK off stdout: its lines go to `logging`, under this module's name."""
    _log.log(10 * (int(level) + 1), "%s", message)
    return True
