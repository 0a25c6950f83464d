"""Monitors the robot's odometry, battery and lens, and whether it may still be driven."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from adatracker_deploy.core.stamps import Fresh
from adatracker_deploy.runtime.odometry_monitor import OdometryMonitor
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


class RobotMonitor:
    """Monitors the robot as long as its participant runs."""

    def __init__(self, participant: Participant, connection: Connection, clock: Clock) -> None:
        topics = Topics(connection)
        turned = connection.odometry_velocity == "odom"
        driver = Fresh(_read_turned if turned else read_odometry, clock)
        self.odometry = Subscriber(
            participant,
            topics.odometry,
            type_name=ODOMETRY,
            qos=connection.odometry_qos,
            decode=driver,
            clock=clock,
        )
        self.freshness = OdometryMonitor(self.odometry, driver, clock, connection.odometry_timeout_s)
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

    def trouble(self) -> str:
        """Return why the robot must not be driven any further; empty while it may."""
        return self.freshness.trouble()


def _read_turned(message: Any) -> Odometry:
    """Read odometry with its velocity in the odometry frame; the only place where that is converted."""
    return in_body(read_odometry(message))
