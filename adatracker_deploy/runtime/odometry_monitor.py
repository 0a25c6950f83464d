"""Whether a robot's odometry is fresh enough to drive it."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any, Protocol

from adatracker_deploy.runtime.robot_clock import clock_ahead_s

if TYPE_CHECKING:
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.stamps import Fresh, Reading, Stamped

_UNSETTLED_S = 1.0
"""Machine time after a restart of the driver during which its odometry is not trusted."""


class _Subscriber(Protocol):
    @property
    def newest(self) -> Reading[Stamped] | None: ...


class OdometryMonitor:
    """Judges what a subscriber to odometry has received last.

    Args:
        subscriber: to the odometry.
        driver: what decodes it, and knows when its stamps went back.
        clock: the run's.
        timeout_s: largest age of odometry by which a robot may be driven, machine seconds.
    """

    def __init__(
        self, subscriber: _Subscriber, driver: Fresh[Any, Any], clock: Clock, timeout_s: float
    ) -> None:
        self._subscriber = subscriber
        self._driver = driver
        self._clock = clock
        self._timeout_s = timeout_s

    def age_s(self) -> float:
        """Return the machine's seconds since the newest odometry; infinite before the first."""
        newest = self._subscriber.newest
        return (self._clock.now_ns() - newest.t_ns) / 1e9 / self._clock.speed if newest else math.inf

    def clock_ahead_s(self) -> float | None:
        """Compare this machine's clock with the newest odometry's stamp (`robot_clock`)."""
        newest = self._subscriber.newest
        if newest is None:
            return None
        return clock_ahead_s(newest.value.stamp_ns, time.time_ns() - round(self.age_s() * 1e9))

    def trouble(self) -> str:
        """Return why the robot must not be driven by it; empty while it may."""
        if self._driver.restarted_s() < _UNSETTLED_S:
            return "the odometry's time stamps went back: its driver was restarted, or there are two"
        if (age_s := self.age_s()) > self._timeout_s:
            return f"no odometry for {age_s:.2f} s: the robot or the link to it is down"
        return ""
