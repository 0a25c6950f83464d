"""Feeds the watchdog of the systemd unit that a trial runs in (sd_notify(3)); without such a unit, nothing.

The link feeds it after each of its slots. A unit whose link has not run for ``WatchdogSec=`` is ended by
systemd, also where the tracker, which notices a hung link after 3 s, does not run either.
"""

from __future__ import annotations

import contextlib
import os
import socket
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

SOCKET_VARIABLE, PERIOD_VARIABLE = "NOTIFY_SOCKET", "WATCHDOG_USEC"
_FEEDS = 4
"""In each period of the watchdog; sd_watchdog_enabled(3) wants two."""
_RESTING_US = 24 * 3600 * 1_000_000
"""Period while no link runs, us: between two trials nothing feeds it, and nothing moves."""


class ServiceWatchdog:
    """The unit's watchdog, seen from the link.

    Args:
        environment: of the process; systemd sets the socket, and the period where the unit has one.
        seconds: the machine's monotonic time.
    """

    def __init__(
        self,
        environment: Mapping[str, str] = os.environ,
        seconds: Callable[[], float] = time.monotonic,
    ) -> None:
        self._seconds = seconds
        self._fed_s = -float("inf")
        period = environment.get(PERIOD_VARIABLE, "")
        self._period_us = int(period) if period.isdecimal() else 0
        self._socket: socket.socket | None = None
        path = environment.get(SOCKET_VARIABLE, "")
        if not path:
            return
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        self._socket.setblocking(False)
        try:
            self._socket.connect(f"\0{path[1:]}" if path.startswith("@") else path)
        except OSError:
            self.close()

    def begin(self) -> None:
        """Say that the robot is connected, and set the unit's own period."""
        self._say("READY=1", *([f"WATCHDOG_USEC={self._period_us}", "WATCHDOG=1"] if self._period_us else ()))

    def feed(self) -> None:
        """Say that the link runs, a few times in each period; takes microseconds and never blocks."""
        now_s = self._seconds()
        if self._period_us and now_s - self._fed_s >= self._period_us / 1e6 / _FEEDS:
            self._fed_s = now_s
            self._say("WATCHDOG=1")

    def rest(self) -> None:
        """Say that the robot is at rest and the link ends: nobody feeds until the next one begins."""
        if self._period_us:
            self._say(f"WATCHDOG_USEC={_RESTING_US}", "WATCHDOG=1")
        self.close()

    def close(self) -> None:
        """Let go of the socket; may be called twice."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _say(self, *lines: str) -> None:
        if self._socket is not None:
            with contextlib.suppress(OSError):  # a full or lost socket must not stop the link
                self._socket.send("\n".join(lines).encode())
