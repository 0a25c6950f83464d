"""Driving for the conformance suite: sending at the link's rate, and measuring."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from adatracker_deploy.core.geometry import Pose
    from adatracker_deploy.core.messages import PlatformState, Twist
    from adatracker_deploy.platform import Platform

SEND_PERIOD_S = 0.02
"""The link sends at 50 Hz."""


def every(platform: Platform, period_s: float, duration_s: float) -> Iterator[PlatformState]:
    """Yield the state at absolute deadlines on the platform's clock."""
    clock = platform.clock
    start_ns = clock.now_ns()
    for tick in range(round(duration_s / period_s)):
        clock.sleep_until(start_ns + round(tick * period_s * 1e9))
        yield platform.state()


def drive(platform: Platform, command: Twist, duration_s: float) -> None:
    """Send one velocity at the link's rate."""
    for _ in every(platform, SEND_PERIOD_S, duration_s):
        platform.send(command, platform.clock.now_ns())


def pose(platform: Platform) -> Pose:
    """Return where a robot is that knows it."""
    found = platform.state().pose
    assert found is not None
    return found


def distance(before: Pose | None, after: Pose | None) -> float:
    """Return the horizontal distance in m; 0 for a robot that does not know where it is yet."""
    return 0.0 if before is None or after is None else before.distance_to(after.x, after.y)


def speed(platform: Platform) -> float:
    """Watch the robot for a second and return how far it went, m/s: velocity estimates can be biased."""
    before = pose(platform)
    platform.clock.sleep_until(platform.clock.now_ns() + 1_000_000_000)
    return distance(before, pose(platform))
