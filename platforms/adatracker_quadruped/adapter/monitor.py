"""Monitors the robot's telemetry, and whether it may still be driven."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import zenoh

from adatracker_deploy.core.stamps import Fresh
from adatracker_deploy.perception.zenoh_graph import is_ours
from adatracker_deploy.runtime.odometry_monitor import OdometryMonitor
from adatracker_quadruped.adapter.subscriber import Subscriber
from adatracker_quadruped.protocol.cdr import SMALL_CAP_BYTES
from adatracker_quadruped.protocol.keys import Keys
from adatracker_quadruped.protocol.messages import (
    Odometry,
    decode_battery,
    decode_imu,
    decode_odometry,
    in_body,
)
from adatracker_quadruped.protocol.rehearsal_keys import SitlKeys
from adatracker_quadruped.protocol.unitree import decode_low_state, decode_sport_mode_state

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    from adatracker_deploy.core.clock import Clock
    from adatracker_quadruped.protocol.connection import Connection

_MOST_TOKENS = 64
"""Cap on tokens: invented ones must not fill the memory."""


class RobotMonitor:
    """Monitors the robot as long as its session is open."""

    def __init__(self, session: zenoh.Session, connection: Connection, clock: Clock) -> None:
        keys = Keys(connection)
        self._connection = connection
        driver = Fresh(_odometry_decoder(connection), clock)
        self.odometry = Subscriber(session, keys.odometry, driver, clock, SMALL_CAP_BYTES)
        self.freshness = OdometryMonitor(self.odometry, driver, clock, connection.odometry_timeout_s)
        self.imu = self.battery = self._tokens = self._rehearsal = None
        if keys.imu:
            self.imu = Subscriber(session, keys.imu, Fresh(decode_imu, clock), clock, SMALL_CAP_BYTES)
        if keys.battery:
            decode = decode_low_state if connection.battery == "low_state" else decode_battery
            self.battery = Subscriber(session, keys.battery, decode, clock, SMALL_CAP_BYTES)
        if connection.robot_liveliness:
            self._tokens = _Tokens(session, connection.robot_liveliness)
        if run := SitlKeys(connection).run:
            self._rehearsal = _Tokens(session, run)

    @property
    def subscribers(self) -> tuple[Subscriber[Any], ...]:
        """All that must be heard."""
        every = (self.odometry, self.imu, self.battery)
        return tuple(subscriber for subscriber in every if subscriber is not None)

    @property
    def dropped(self) -> int:
        """Number of malformed messages, on all keys."""
        return sum(subscriber.dropped for subscriber in self.subscribers)

    def meant(self) -> bool:
        """Return whether this is the right robot; in a rehearsal only the one that it has started is."""
        return self._rehearsal is None or self._rehearsal.alive()

    def trouble(self) -> str:
        """Return why the robot must not be driven any further; empty while it may."""
        if not self.meant():
            return "the robot is gone: the simulated one that this rehearsal has started is not there"
        if self._tokens is not None and not self._tokens.alive():
            return f"the robot is gone: no liveliness token {self._connection.robot_liveliness}"
        return self.freshness.trouble()

    def join(self) -> None:
        """Wait for the end of every thread; close the session first."""
        for subscriber in self.subscribers:
            subscriber.join()


def _odometry_decoder(connection: Connection) -> Callable[[bytes], Odometry]:
    """Return what decodes the odometry; the only place where a velocity in its own frame is turned."""
    decode = decode_sport_mode_state if connection.odometry == "sport_mode_state" else decode_odometry
    return decode if connection.odometry_velocity == "body" else lambda payload: in_body(decode(payload))


class _Tokens:
    """The robot's liveliness tokens: Zenoh tells of each that comes and goes, within 3 ms of a crash.

    Those that this program shows to ROS 2 are not the robot's, wherever they come from.
    """

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._changes = session.liveliness().declare_subscriber(
            key, zenoh.handlers.RingChannel(256), history=True
        )
        self._present: set[str] = set()
        self._lock = threading.Lock()

    def alive(self) -> bool:
        """Return whether at least one is there."""
        with self._lock:
            while (change := self._changes.try_recv()) is not None:
                if is_ours(str(change.key_expr)):
                    continue
                if change.kind == zenoh.SampleKind.PUT and len(self._present) < _MOST_TOKENS:
                    self._present.add(str(change.key_expr))
                else:
                    self._present.discard(str(change.key_expr))
            return bool(self._present)
