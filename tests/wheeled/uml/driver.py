"""Drives a base over ``vcan0`` at 0.5 m/s until it may not: a process that tests send signals to."""

from __future__ import annotations

import dataclasses
import sys

from adatracker_deploy.config.profile import Profile
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.registry import load_profile
from adatracker_wheeled.platform import WheeledPlatform

CRUISE = Twist(vx=0.5)
PERIOD_NS = 20_000_000


def scout_on(channel: str) -> Profile:
    """Return the shipped Scout's profile, on another bus."""
    profile = load_profile("scout", WheeledPlatform)
    connection = dataclasses.replace(profile.connection, interface="socketcan", channel=channel)
    return dataclasses.replace(profile, connection=connection)


def main() -> int:
    """Print why the drive ended; return 1."""
    clock = MonotonicClock()
    with WheeledPlatform(scout_on("vcan0"), clock) as platform:
        platform.connect()
        platform.engage()
        try:
            while True:
                now_ns = clock.now_ns()
                platform.send(CRUISE, now_ns)
                clock.sleep_until(now_ns + PERIOD_NS)
        except PlatformError as error:
            print(error)
            return 1


if __name__ == "__main__":
    sys.exit(main())
