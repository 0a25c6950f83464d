"""The messages that a PX4 vehicle sends by itself: which, and when each is next due."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from pymavlink.dialects.v20 import common as mavlink

from adatracker_drone import telemetry
from adatracker_drone.telemetry import Instant, Message

_STREAMS: dict[int, tuple[Callable[[Instant], Message], float]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: (telemetry.heartbeat, 1),
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: (telemetry.home_position, 0.5),
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: (telemetry.sys_status, 5),
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: (telemetry.extended_sys_state, 5),
    mavlink.MAVLINK_MSG_ID_ATTITUDE: (telemetry.attitude, 100),
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: (telemetry.attitude_quaternion, 50),
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: (telemetry.local_position, 30),
    mavlink.MAVLINK_MSG_ID_ODOMETRY: (telemetry.odometry, 0),
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: (telemetry.global_position_int, 10),
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: (telemetry.gps_raw_int, 5),
    mavlink.MAVLINK_MSG_ID_ALTITUDE: (telemetry.altitude, 10),
    mavlink.MAVLINK_MSG_ID_VFR_HUD: (telemetry.vfr_hud, 4),
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: (telemetry.battery_status, 0.5),
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: (telemetry.estimator_status, 1),
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: (telemetry.system_time, 1),
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: (telemetry.gps_global_origin, 0),
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: (telemetry.autopilot_version, 0),
}
"""What makes each message, and its rate in Hz as PX4's onboard link has it; 0 is on request only."""

_FASTEST_HZ = 250.0


class Streams:
    """When each stream is next due."""

    def __init__(self) -> None:
        self._period_ns = {name: round(1e9 / hz) for name, (_, hz) in _STREAMS.items() if hz}
        self._due_ns = dict.fromkeys(self._period_ns, 0)

    def due(self, now: Instant) -> Iterator[Message]:
        """Yield the messages that are due, each once."""
        for name, due_ns in self._due_ns.items():
            if now.t_ns >= due_ns:
                period = self._period_ns[name]
                # The next multiple of the period, so that a late tick does not lower the rate.
                self._due_ns[name] = due_ns + period * ((now.t_ns - due_ns) // period + 1)
                yield _STREAMS[name][0](now)

    def once(self, name: int, now: Instant) -> Message | None:
        """Return one message by its id, or None where there is no such stream."""
        made = _STREAMS.get(name)
        return made[0](now) if made else None

    def period_us(self, name: int) -> int | None:
        """Return a stream's period, -1 where it is off, or None where there is no such stream."""
        if name not in _STREAMS:
            return None
        return self._period_ns[name] // 1000 if name in self._period_ns else -1

    def set_period_us(self, name: int, period_us: float, now_ns: int) -> bool:
        """Change a stream's period: 0 is the default, negative is off; False where that cannot be."""
        if name not in _STREAMS or not math.isfinite(period_us):
            return False
        default_hz = _STREAMS[name][1]
        hz = 1e6 / period_us if period_us > 0 else default_hz if period_us == 0 else 0.0
        if hz < 1e-3:
            self._period_ns.pop(name, None)
            self._due_ns.pop(name, None)
            return True
        self._period_ns[name] = round(1e9 / min(hz, _FASTEST_HZ))
        self._due_ns[name] = now_ns
        return True
