"""Preflight probe: listens to a robot long enough to check it."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from adatracker_deploy.core.clock import until
from adatracker_quadruped.adapter.preflight import RobotTelemetry

if TYPE_CHECKING:
    from adatracker_quadruped.adapter.monitor import RobotMonitor
    from adatracker_quadruped.adapter.transport import Wire

_LISTEN_S = 0.5
"""Shortest time over which odometry is counted."""
_COMPLETE_S = 2.0
"""Longest wait for a battery charge (sent once a second), an attitude and an image."""


def probe(wire: Wire, camera_key: str) -> RobotTelemetry:
    """Return what is received within two seconds, or half a second if everything has arrived.

    Args:
        wire: open.
        camera_key: key of the images; empty for none.
    """
    watch = wire.watch
    began_s, before = time.monotonic(), watch.odometry.newest
    camera_heard = bool(camera_key) and wire.hears(camera_key, _COMPLETE_S)
    until(lambda: all(heard.newest is not None for heard in watch.subscribers), began_s + _COMPLETE_S)
    until(lambda: time.monotonic() > began_s + _LISTEN_S, began_s + _COMPLETE_S)
    after, listened_s = watch.odometry.newest, time.monotonic() - began_s
    return RobotTelemetry(
        command_key=wire.commander.key,
        matched=wire.commander.matched,
        has_rival=not wire.lease.take(),
        trouble=watch.trouble(),
        odometry_hz=(after.count - before.count) / listened_s if after and before else 0.0,
        attitude=_attitude(watch),
        battery=watch.battery.newest.value if watch.battery and watch.battery.newest else None,
        camera_key=camera_key,
        camera_heard=camera_heard,
        clock_ahead_s=watch.freshness.clock_ahead_s(),
        dropped=watch.dropped,
    )


def _attitude(watch: RobotMonitor) -> tuple[float, float, float] | None:
    """Return roll, pitch and yaw, rad, as the IMU says, or the odometry of a robot whose IMU is not named."""
    if watch.imu is not None:
        return watch.imu.newest.value.attitude if watch.imu.newest else None
    if watch.odometry.newest is None:
        return None
    pose = watch.odometry.newest.value.pose
    return pose.roll, pose.pitch, pose.yaw
