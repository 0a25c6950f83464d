"""What tests do with the adapter of any robot: engage it, drive it, suspend the machine that it runs on."""

from __future__ import annotations

import contextlib
import threading

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError

PERIOD_NS = 20_000_000
"""The link sends at 50 Hz."""


def send_for(platform, command, seconds):
    """Send at 50 Hz, as the link does."""
    clock = platform.clock
    start_ns = clock.now_ns()
    for tick in range(round(seconds * 1e9 / PERIOD_NS)):
        clock.sleep_until(start_ns + tick * PERIOD_NS)
        platform.send(command, clock.now_ns())


def engages(platform):
    """Engage, unless that is refused; return whether the robot is engaged."""
    with contextlib.suppress(PlatformError):
        platform.engage()
    return platform.state().engaged


class Engaging(threading.Thread):
    """Engages in a thread of its own; `why` is the reason of a refusal, empty without one."""

    def __init__(self, platform):
        super().__init__()
        self.why = ""
        self._platform = platform

    def run(self):
        try:
            self._platform.engage()
        except PlatformError as error:
            self.why = str(error)


class Sleepy(MonotonicClock):
    """A clock of a machine that can be suspended; it stands still meanwhile, so only `suspended_ns` tells."""

    asleep_ns = 0

    def suspended_ns(self):
        return type(self).asleep_ns
