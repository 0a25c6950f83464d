"""Sensor publishers of the simulated robot: odometry, IMU and battery, each at its rate."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from adatracker_quadruped.protocol.keys import Keys
from adatracker_quadruped.protocol.messages import (
    Imu,
    Odometry,
    encode_battery,
    encode_imu,
    encode_odometry,
    in_odom,
)
from adatracker_quadruped.protocol.publisher import Publisher
from adatracker_quadruped.protocol.rehearsal_keys import Fault
from adatracker_quadruped.protocol.unitree import encode_low_state, encode_sport_mode_state

if TYPE_CHECKING:
    import zenoh

    from adatracker_deploy.core.geometry import Pose
    from adatracker_quadruped.protocol.connection import Connection
    from adatracker_quadruped.sim.dynamics import QuadrupedBody
    from adatracker_quadruped.sim.settings import SitlSettings

_BATTERY_HZ = 1.0
_LOW = 0.05
_GRAVITY_M_S2 = 9.81
_TIPPED_ROLL = math.radians(85.0)


class Senses:
    """Publishes what is due, on the topics that the connection names."""

    def __init__(self, session: zenoh.Session, connection: Connection, settings: SitlSettings) -> None:
        keys = Keys(connection)
        self._settings = settings
        self._in_odom = connection.odometry_velocity == "odom"
        self._unitree = connection.odometry == "sport_mode_state"
        self._low_state = connection.battery == "low_state"
        self._odometry = _Due(session, keys.odometry, settings.odometry_hz, attaches=keys.attaches)
        self._imu = _Due(session, keys.imu, settings.imu_hz, attaches=keys.attaches)
        self._battery = _Due(session, keys.battery, _BATTERY_HZ, attaches=keys.attaches)
        self._said = b""
        """The newest odometry."""

    def tell(self, body: QuadrupedBody, faults: frozenset[Fault], now_ns: int, unix_ns: int) -> None:
        """Publish each topic whose period has passed.

        Args:
            body: as it is now.
            faults: its active faults.
            now_ns: by the run's clock, in which the rates are.
            unix_ns: the stamp, since 1970.
        """
        if Fault.SILENT in faults:
            return
        if self._odometry.due(now_ns):
            if Fault.FROZEN_ODOMETRY not in faults:
                pose = _trunk(body, faults) if self._unitree else body.pose
                moves = Odometry(pose, body.velocity, unix_ns)
                encode = encode_sport_mode_state if self._unitree else encode_odometry
                self._said = encode(in_odom(moves) if self._in_odom else moves)
            self._odometry.put(self._said, unix_ns)
        if self._imu.due(now_ns):
            self._imu.put(encode_imu(_inertia(body, faults, unix_ns)), unix_ns)
        if self._battery.due(now_ns):
            charge = _LOW if Fault.LOW_BATTERY in faults else self._settings.battery
            told = encode_low_state(charge) if self._low_state else encode_battery(charge, unix_ns)
            self._battery.put(told, unix_ns)


def _inertia(body: QuadrupedBody, faults: frozenset[Fault], unix_ns: int) -> Imu:
    trunk = _trunk(body, faults)
    ax, ay, az = (float(g) for g in trunk.rotation()[2] * _GRAVITY_M_S2)
    return Imu(
        attitude=(trunk.roll, trunk.pitch, trunk.yaw),
        angular_velocity_rad_s=(0.0, 0.0, body.velocity.yaw_rate),
        acceleration_m_s2=(ax, ay, az),
        stamp_ns=unix_ns,
    )


def _trunk(body: QuadrupedBody, faults: frozenset[Fault]) -> Pose:
    return replace(body.trunk, roll=_TIPPED_ROLL) if Fault.TIPPED_OVER in faults else body.trunk


class _Due:
    """A publisher with a period; a missed slot is skipped."""

    def __init__(self, session: zenoh.Session, key: str, rate_hz: float, *, attaches: bool) -> None:
        self._publisher = Publisher(session, key, attaches=attaches) if key else None
        self._period_ns = round(1e9 / rate_hz)
        self._next_ns = 0

    def due(self, now_ns: int) -> bool:
        if self._publisher is None or now_ns < self._next_ns:
            return False
        self._next_ns = max(self._next_ns + self._period_ns, now_ns + self._period_ns // 2)
        return True

    def put(self, payload: bytes, unix_ns: int) -> None:
        if self._publisher is not None and payload:
            self._publisher.put(payload, unix_ns)
