"""Preflight probe: listens to a robot long enough to check it, and asks its driver."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from adatracker_deploy.core.clock import until
from adatracker_ros2.adapter.preflight import RobotTelemetry

if TYPE_CHECKING:
    from adatracker_ros2.adapter.transport import Wire

_LISTEN_S = 0.5
"""Shortest time over which odometry is counted, and other publishers are looked for."""
_COMPLETE_S = 2.0
"""Longest wait for a battery charge (sent once a second), the camera's topic and its camera_info."""


def probe(wire: Wire, camera_topic: str) -> RobotTelemetry:
    """Return what is heard within two seconds, or half a second if everything has arrived.

    Args:
        wire: open.
        camera_topic: of the images; empty for none.
    """
    watch = wire.watch
    began_s, before = time.monotonic(), watch.odometry.newest
    told = wire.driver.ask()
    camera_there = bool(camera_topic) and wire.publishes(camera_topic, _COMPLETE_S)
    until(lambda: all(heard.newest is not None for heard in watch.subscribers), began_s + _COMPLETE_S)
    lens = watch.lens if watch.lens is not None and wire.publishes(watch.lens.topic, 0.0) else None
    if lens is not None:
        until(lambda: lens.newest is not None, began_s + _COMPLETE_S)
    until(lambda: time.monotonic() > began_s + _LISTEN_S, began_s + _COMPLETE_S)
    after, listened_s = watch.odometry.newest, time.monotonic() - began_s
    return RobotTelemetry(
        command_topic=wire.commander.topic,
        matched=wire.commander.matched,
        rival=wire.ownership.rival(),
        trouble=watch.trouble(),
        odometry_hz=(after.count - before.count) / listened_s if after and before else 0.0,
        battery=watch.battery.newest.value if watch.battery and watch.battery.newest else None,
        timeout_s=told.timeout_s,
        state=told.state,
        camera_topic=camera_topic,
        camera_there=camera_there,
        camera_info_topic=lens.topic if lens else "",
        camera_info_came=bool(lens and lens.newest),
        lens=lens.newest.value if lens and lens.newest else None,
        clock_ahead_s=watch.freshness.clock_ahead_s(),
        dropped=wire.dropped,
    )
