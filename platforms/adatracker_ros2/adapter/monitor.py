"""Monitors the robot's odometry, battery and lens, and whether it may still be driven."""

from __future__ import annotations

import math
import time
from functools import partial
from typing import TYPE_CHECKING

from adatracker_deploy.core.stamps import Fresh
from adatracker_deploy.runtime.robot_clock import clock_ahead_s
from adatracker_ros2.adapter.subscriber import Subscriber
from adatracker_ros2.protocol.connection import Qos
from adatracker_ros2.protocol.messages import (
    Odometry,
    in_body,
    read_battery,
    read_camera_info,
    read_odometry,
)
from adatracker_ros2.protocol.topics import BATTERY_STATE, CAMERA_INFO, ODOMETRY, Topics, is_rectified

if TYPE_CHECKING:
    from typing import Any

    from adatracker_deploy.core.camera_info import CameraInfo
    from adatracker_deploy.core.clock import Clock
    from adatracker_ros2.protocol.connection import Connection
    from adatracker_ros2.protocol.participant import Participant

UNSETTLED_S = 1.0
"""Machine time after a restart of the driver during which its odometry is not trusted."""


class RobotMonitor:
    """Monitors the robot as long as its participant runs."""

    def __init__(self, participant: Participant, connection: Connection, clock: Clock) -> None:
        topics = Topics(connection)
        self._connection = connection
        self._clock = clock
        turned = connection.odometry_velocity == "odom"
        self._driver = Fresh(_read_turned if turned else read_odometry, clock)
        self.odometry = Subscriber(
            participant,
            topics.odometry,
            type_name=ODOMETRY,
            qos=connection.odometry_qos,
            decode=self._driver,
            clock=clock,
        )
        self.battery: Subscriber[float | None] | None = None
        if topics.battery:
            self.battery = Subscriber(
                participant,
                topics.battery,
                type_name=BATTERY_STATE,
                qos=Qos(),
                decode=read_battery,
                clock=clock,
            )
        self.lens: Subscriber[CameraInfo | None] | None = None
        """Nothing depends on it: it may be absent, or of another type."""
        if topics.camera_info:
            self.lens = Subscriber(
                participant,
                topics.camera_info,
                type_name=CAMERA_INFO,
                qos=Qos(),
                decode=partial(read_camera_info, rectified=is_rectified(topics.camera)),
                clock=clock,
            )

    @property
    def subscribers(self) -> tuple[Subscriber[Any], ...]:
        """All that must be heard."""
        return (self.odometry,) if self.battery is None else (self.odometry, self.battery)

    @property
    def dropped(self) -> int:
        """Number of malformed or repeated messages, on all topics."""
        return sum(subscriber.dropped for subscriber in self.subscribers)

    def odometry_age_s(self) -> float:
        """Return the machine's seconds since the newest odometry; infinite before the first."""
        newest = self.odometry.newest
        return (self._clock.now_ns() - newest.t_ns) / 1e9 / self._clock.speed if newest else math.inf

    def clock_ahead_s(self) -> float | None:
        """Compare this machine's clock with the newest odometry's stamp (`robot_clock`)."""
        newest = self.odometry.newest
        if newest is None:
            return None
        return clock_ahead_s(newest.value.stamp_ns, time.time_ns() - round(self.odometry_age_s() * 1e9))

    def trouble(self) -> str:
        """Return why the robot must not be driven any further; empty while it may."""
        if self._driver.restarted_s() < UNSETTLED_S:
            return "the odometry's time stamps went back: its driver was restarted, or there are two"
        if (age_s := self.odometry_age_s()) > self._connection.odometry_timeout_s:
            return f"no odometry for {age_s:.2f} s: the robot or the link to it is down"
        return ""


def _read_turned(message: Any) -> Odometry:
    """Read odometry with its velocity in the odometry frame; the only place where that is converted."""
    return in_body(read_odometry(message))
