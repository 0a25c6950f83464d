"""A simulated PX4: answers MAVLink messages and flies the vehicle.

Pure: decoded messages, the vehicle's true motion and the time go in; messages and a velocity demand come out.
`commander` decides on arming and modes, `navigator` where a mode flies, `streams` what is sent and when;
`services` answers requests unrelated to flight.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from adatracker_deploy.core.messages import Twist
from adatracker_drone.protocol.dialect import Event
from adatracker_drone.protocol.events import number_of
from adatracker_drone.protocol.frames import rotate
from adatracker_drone.protocol.px4 import Mode, Result
from adatracker_drone.sim import services
from adatracker_drone.sim.commander import FORCE, Commander, Said
from adatracker_drone.sim.dynamics import Power
from adatracker_drone.sim.estimator import Estimator
from adatracker_drone.sim.motion import HOME_ALTITUDE_M, Motion, Velocity
from adatracker_drone.sim.navigator import NOTHING, Navigator, Ned, SetPoint
from adatracker_drone.sim.parameters import Parameters
from adatracker_drone.sim.settings import SitlSettings
from adatracker_drone.sim.streams import Streams
from adatracker_drone.sim.telemetry import Instant, Message

COMPONENT = mavlink.MAV_COMP_ID_AUTOPILOT1

_BATTERY_LASTS_S = 1200.0
"""A 450-class quadrotor's flight on one charge."""
_FRAMES = {
    mavlink.MAV_FRAME_LOCAL_NED: False,
    mavlink.MAV_FRAME_BODY_NED: True,
    mavlink.MAV_FRAME_BODY_FRD: True,
}
"""Frames of set-points, and whether they turn with the heading."""


class Identity(NamedTuple):
    """A vehicle's identity in MAVLink."""

    system: int = 1
    """MAV_SYS_ID."""
    uid: bytes = bytes(18)
    """AUTOPILOT_VERSION's uid2."""


NOBODY = Identity()


class Autopilot:
    """One vehicle's autopilot.

    Args:
        settings: of the simulated vehicle.
        seed: of its estimation errors.
        speed: times real time; link-loss times are scaled with it.
        identity: who it is.

    Raises:
        UsageError: a parameter in the settings does not exist or is out of range.
    """

    def __init__(
        self, settings: SitlSettings, seed: int, speed: float = 1.0, identity: Identity = NOBODY
    ) -> None:
        self.identity = identity
        self.parameters = Parameters(settings.parameters)
        self.commander = Commander(
            self.parameters,
            ekf_ready_s=settings.ekf_ready_s,
            landing_detected_s=settings.landing_detected_s,
            speed=speed,
        )
        self.commander.battery = settings.battery
        self._navigator = Navigator(self.parameters)
        self._estimator = Estimator(settings, seed)
        self._streams = Streams(tells_current_mode=settings.tells_current_mode)
        self._events = 0
        self._out: list[Message] = []
        self._set_point = SetPoint()
        self._estimate = Motion()
        self._now_s = 0.0
        self._navigated: Mode | None = None

    @property
    def at_rest(self) -> bool:
        """On the ground and disarmed."""
        return self.commander.landed and not self.commander.armed

    def power(self) -> Power:
        """Return what the motors do."""
        if not self.commander.armed:
            return Power.OFF
        return Power.FLY if self.commander.lifts else Power.IDLE

    def step(self, truth: Motion, now_s: float) -> Velocity:
        """Judge the situation at `now_s` since power-on; return the velocity to fly.

        The demand is made from the estimate and then corrected by its error: a controller that holds an
        estimated velocity really flies that velocity less the estimation error.
        """
        dt_s, self._now_s = now_s - self._now_s, now_s
        self._estimate = self._estimator.measure(truth, dt_s)
        commander = self.commander
        if not commander.landed:
            commander.battery = max(0.0, commander.battery - dt_s / _BATTERY_LASTS_S)
        commander.update(truth, self._estimate, now_s, climbs=self._climbs())
        if commander.mode is not self._navigated:
            top_m = commander.home_m + commander.takeoff_altitude_m
            self._navigator.enter(commander.mode, self._estimate, top_m)
            self._navigated = commander.mode
        while commander.said:
            self._tell_people(commander.said.popleft())
        demand = self._navigator.demand(self._estimate, self._set_point)
        north, east, down = self._estimator.error_m_s
        forward, right = rotate(north, east, -truth.heading)
        return demand._replace(
            forward=demand.forward - forward, right=demand.right - right, down=demand.down - down
        )

    def _climbs(self) -> bool:
        """Return whether a vehicle on the ground is to lift off."""
        mode = self.commander.mode
        return mode is Mode.TAKEOFF or (
            mode is Mode.OFFBOARD and self._navigator.demand(self._estimate, self._set_point).down < 0
        )

    def _tell_people(self, said: Said) -> None:
        self._out.append(mavlink.MAVLink_statustext_message(said.severity, said.text.encode()))
        if said.event:
            now_ms = round(self._now_s * 1e3)
            self._out.append(Event(number_of(said.event), now_ms, self._events, said.severity))
            self._events += 1

    def transmit(self) -> list[Message]:
        """Return everything there is to send now."""
        messages, self._out = [*self._out, *self._streams.due(self._instant())], []
        return messages

    def farewell(self) -> list[Message]:
        """Return the final messages before power-off, which would otherwise report the landing at only 1
        Hz."""
        self._tell(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
        self._tell(mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE)
        return self.transmit()

    def drain(self, charge: float) -> None:
        """Leave no more than so much in the battery, 0 to 1."""
        self.commander.battery = min(self.commander.battery, charge)

    def receive(self, message: Message) -> None:
        """Take in one decoded message; what is for another vehicle, or not understood, is ignored."""
        if getattr(message, "target_system", 0) not in (0, self.identity.system):
            return
        if getattr(message, "target_component", COMPONENT) not in (0, COMPONENT):
            return
        handler = _HANDLERS.get(message.get_type())
        if handler is not None:
            handler(self, message)
        else:
            self._out += services.answer(message, self.parameters, self._now_s)

    def _instant(self) -> Instant:
        ready = self.commander.ready(self._now_s)
        t_ns = round(self._now_s * 1e9)
        return Instant(t_ns, self._estimate, self.commander, ready, self.identity.uid)

    def _tell(self, number: int) -> bool:
        """Send one message of a stream now; False if there is none, or it has nothing new."""
        message = self._streams.once(number, self._instant())
        if message is not None:
            self._out.append(message)
        return message is not None

    def _on_command_long(self, message: Any) -> None:
        self._obey(message, tuple(getattr(message, f"param{number}") for number in range(1, 8)))

    def _on_command_int(self, message: Any) -> None:
        params = tuple(getattr(message, f"param{number}") for number in range(1, 5))
        self._obey(message, (*params, message.x, message.y, message.z))

    def _obey(self, message: Any, params: tuple[float, ...]) -> None:
        """Carry out a command and acknowledge it to its sender."""
        command = _COMMANDS.get(message.command)
        result = Result.UNSUPPORTED if command is None else command(self, params)
        sender = message.get_srcSystem(), message.get_srcComponent()
        answer = mavlink.MAVLink_command_ack_message(message.command, result, 255, 0, *sender)
        twice = message.command == mavlink.MAV_CMD_DO_SET_MODE  # which PX4's Commander and Navigator answer
        self._out += [answer, answer] if twice else [answer]

    def _arm_disarm(self, params: tuple[float, ...]) -> Result:
        force = params[1] == FORCE
        if params[0] == 1:
            return self.commander.arm(self._now_s, force=force)
        if params[0] == 0:
            return self.commander.disarm(force=force)
        return Result.DENIED

    def _take_off(self, params: tuple[float, ...]) -> Result:
        """Take off to a height above sea level, or to MIS_TAKEOFF_ALT if that is not above home."""
        above_home_m = params[6] - HOME_ALTITUDE_M
        return self.commander.takeoff(above_home_m if above_home_m > 0 else math.nan, self._now_s)

    def _land(self, _: tuple[float, ...]) -> Result:
        return self.commander.request(Mode.LAND, self._now_s)

    def _return(self, _: tuple[float, ...]) -> Result:
        return self.commander.request(Mode.RTL, self._now_s)

    def _set_mode(self, params: tuple[float, ...]) -> Result:
        base, main, sub = (_whole(param) for param in params[:3])
        return self._switch(base, Mode.find(main, sub))

    def _on_set_mode(self, message: Any) -> None:
        """Switch modes the old way; PX4 does not acknowledge it."""
        main, sub = message.custom_mode >> 16 & 0xFF, message.custom_mode >> 24
        self._switch(message.base_mode, Mode.find(main, sub))

    def _switch(self, base: int, mode: Mode | None) -> Result:
        if base < 0 or not base & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return Result.DENIED
        return Result.UNSUPPORTED if mode is None else self.commander.request(mode, self._now_s)

    def _set_interval(self, params: tuple[float, ...]) -> Result:
        now_ns = round(self._now_s * 1e9)
        return self._streams.set_period_us(_whole(params[0]), params[1], now_ns)

    def _get_interval(self, params: tuple[float, ...]) -> Result:
        number = _whole(params[0])
        period_us = self._streams.period_us(number)
        if period_us is None:
            return Result.DENIED
        self._out.append(mavlink.MAVLink_message_interval_message(number, period_us))
        return Result.ACCEPTED

    def _tell_version(self, _: tuple[float, ...]) -> Result:
        self._tell(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        return Result.ACCEPTED

    def _tell_home(self, _: tuple[float, ...]) -> Result:
        self._tell(mavlink.MAVLINK_MSG_ID_HOME_POSITION)
        return Result.ACCEPTED

    def _request_message(self, params: tuple[float, ...]) -> Result:
        return Result.ACCEPTED if self._tell(_whole(params[0])) else Result.DENIED

    def _on_local_target(self, message: Any) -> None:
        level_body = _FRAMES.get(message.coordinate_frame)
        if level_body is None:
            return

        def unless(bit: int, value: float) -> float:
            return math.nan if message.type_mask & bit else value

        place = Ned(unless(1, message.x), unless(2, message.y), unless(4, message.z))
        set_point = SetPoint(
            position=NOTHING if level_body else place,
            velocity=Ned(unless(8, message.vx), unless(16, message.vy), unless(32, message.vz)),
            level_body=level_body,
            heading=unless(1024, message.yaw),
            yaw_rate=unless(2048, message.yaw_rate),
        )
        if set_point.asks:
            self._set_point = set_point
            self.commander.heard_set_point(self._now_s)


def velocity_of(message: Message) -> Twist | None:
    """Return the velocity in the body frame that a set-point asks for; None for any other message."""
    if message.get_type() != "SET_POSITION_TARGET_LOCAL_NED" or not _FRAMES.get(message.coordinate_frame):
        return None
    return Twist(message.vx, -message.vy, -message.vz, -message.yaw_rate)


def _whole(value: float) -> int:
    """Return a parameter that is a number of something, or -1."""
    return int(value) if math.isfinite(value) else -1


_HANDLERS: dict[str, Callable[[Autopilot, Any], None]] = {
    "COMMAND_LONG": Autopilot._on_command_long,
    "COMMAND_INT": Autopilot._on_command_int,
    "SET_MODE": Autopilot._on_set_mode,
    "SET_POSITION_TARGET_LOCAL_NED": Autopilot._on_local_target,
}

_COMMANDS: dict[int, Callable[[Autopilot, tuple[float, ...]], Result]] = {
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM: Autopilot._arm_disarm,
    mavlink.MAV_CMD_NAV_TAKEOFF: Autopilot._take_off,
    mavlink.MAV_CMD_NAV_LAND: Autopilot._land,
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: Autopilot._return,
    mavlink.MAV_CMD_DO_SET_MODE: Autopilot._set_mode,
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: Autopilot._set_interval,
    mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: Autopilot._get_interval,
    mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: Autopilot._tell_version,
    mavlink.MAV_CMD_GET_HOME_POSITION: Autopilot._tell_home,
    mavlink.MAV_CMD_REQUEST_MESSAGE: Autopilot._request_message,
}
