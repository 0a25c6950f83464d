"""The telemetry streams of a PX4 vehicle: messages, rates and due times."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from pymavlink.dialects.v20 import common as mavlink

from adatracker_drone.protocol.packets import CURRENT_MODE
from adatracker_drone.protocol.px4 import Result
from adatracker_drone.sim import telemetry
from adatracker_drone.sim.telemetry import Instant, Message

_STREAMS: dict[int, tuple[Callable[[Instant], Message], float]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: (telemetry.heartbeat, 1),
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: (telemetry.home_position, 0.5),
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: (telemetry.sys_status, 5),
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: (telemetry.extended_sys_state, 5),
    mavlink.MAVLINK_MSG_ID_ATTITUDE: (telemetry.attitude, 100),
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: (telemetry.attitude_quaternion, 50),
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: (telemetry.local_position, 30),
    mavlink.MAVLINK_MSG_ID_ODOMETRY: (telemetry.odometry, 30),
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: (telemetry.global_position_int, 50),
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: (telemetry.gps_raw_int, 8),
    mavlink.MAVLINK_MSG_ID_ALTITUDE: (telemetry.altitude, 10),
    mavlink.MAVLINK_MSG_ID_VFR_HUD: (telemetry.vfr_hud, 10),
    mavlink.MAVLINK_MSG_ID_TIMESYNC: (telemetry.timesync, 10),
    CURRENT_MODE: (telemetry.current_mode, 0.5),
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: (telemetry.battery_status, 0.5),
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: (telemetry.estimator_status, 1),
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: (telemetry.system_time, 1),
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: (telemetry.gps_global_origin, 0),
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: (telemetry.autopilot_version, 0),
}
"""The maker of each message, and its rate in Hz as PX4's onboard link has it; 0 is on request only."""

_FASTEST_HZ = 250.0


class Streams:
    """The schedule of the streams.

    CURRENT_MODE differs from the others: it is sent only when `vehicle_status` was published since it was
    last sent, and then at once if its interval has passed.

    Args:
        tells_current_mode: False for a PX4 that has no such message.
    """

    def __init__(self, *, tells_current_mode: bool = True) -> None:
        self._known = {
            name: made for name, made in _STREAMS.items() if tells_current_mode or name != CURRENT_MODE
        }
        self._period_ns = {name: round(1e9 / hz) for name, (_, hz) in self._known.items() if hz}
        self._due_ns = dict.fromkeys(self._period_ns, 0)
        self._mode_told_s = -1.0

    def due(self, now: Instant) -> Iterator[Message]:
        """Yield the messages that are due, each once."""
        for name, due_ns in self._due_ns.items():
            if now.t_ns < due_ns:
                continue
            period = self._period_ns[name]
            if name == CURRENT_MODE:
                if (told := self.once(name, now)) is not None:
                    self._due_ns[name] = now.t_ns + period
                    yield told
                continue
            # The next multiple of the period, so that a late tick does not lower the rate.
            self._due_ns[name] = due_ns + period * ((now.t_ns - due_ns) // period + 1)
            yield self._known[name][0](now)

    def once(self, name: int, now: Instant) -> Message | None:
        """Return one message by its id, or None where there is no such stream, or nothing new in it."""
        made = self._known.get(name)
        if name == CURRENT_MODE and made is not None:
            if now.commander.published_s <= self._mode_told_s:
                return None
            self._mode_told_s = now.commander.published_s
        return made[0](now) if made else None

    def period_us(self, name: int) -> int | None:
        """Return a stream's period, -1 where it is off, or None where there is no such stream."""
        if name not in self._known:
            return None
        return self._period_ns[name] // 1000 if name in self._period_ns else -1

    def set_period_us(self, name: int, period_us: float, now_ns: int) -> Result:
        """Change a stream's period: 0 is the default, negative is off. PX4 keeps HEARTBEAT at 1 Hz."""
        if name == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            return Result.FAILED
        if name not in self._known or not math.isfinite(period_us):
            return Result.DENIED
        default_hz = self._known[name][1]
        hz = 1e6 / period_us if period_us > 0 else default_hz if period_us == 0 else 0.0
        if hz < 1e-3:
            self._period_ns.pop(name, None)
            self._due_ns.pop(name, None)
            return Result.ACCEPTED
        self._period_ns[name] = round(1e9 / min(hz, _FASTEST_HZ))
        self._due_ns[name] = now_ns
        return Result.ACCEPTED
