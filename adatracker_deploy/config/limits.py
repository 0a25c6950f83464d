"""The profile's ``limits:`` section, enforced by the gate: what a robot may do, and when it must stop.

Every limit is on by default. `Limits.switched_off` is the only way to disable one, and every trial reports
it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Literal

from adatracker_deploy.config.schema import Range
from adatracker_deploy.core.errors import UsageError

Dispensable = Literal[
    "altitude", "battery", "geofence", "jerk", "position_jumped", "ramp", "state_lost", "too_close"
]
"""The gate's reasons that a profile may switch off. The rest (`not_finite`, `envelope`, `acceleration`,
the age of commands, a robot that stopped by itself) cannot be switched off."""

_Height = Annotated[float, Range(-100, 500)]
_Offset = Annotated[float, Range(-10_000, 10_000)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """The gate's limits and time-outs; every value is a magnitude."""

    forward_m_s: Annotated[float, Range(0, 30)]
    backward_m_s: Annotated[float, Range(0, 30)]
    lateral_m_s: Annotated[float, Range(0, 30)] = 0.0
    vertical_m_s: Annotated[float, Range(0, 10)] = 0.0
    yaw_rate_rad_s: Annotated[float, Range(0, 10)]
    accel_m_s2: Annotated[float, Range(0.01, 50)]
    """Largest change of the horizontal and of the vertical velocity, per second."""
    yaw_accel_rad_s2: Annotated[float, Range(0.01, 100)]
    jerk_m_s3: Annotated[float, Range(0.1, 1000)] = 20.0
    """Largest change of the horizontal and of the vertical acceleration, per second."""
    yaw_jerk_rad_s3: Annotated[float, Range(0.1, 2000)] = 50.0
    ramp_s: Annotated[float, Range(0.05, 10)] = 1.0
    """Time over which the speed limits grow from zero to full, from the first motion after engaging."""
    command_timeout_s: Annotated[float, Range(0.02, 2)] = 0.18
    """A command older than this is replaced by zero. With one slot of the link, the last motion is sent
    within 0.2 s of the tracker's last command."""
    sight_timeout_s: Annotated[float, Range(0.1, 2)] = 0.27
    """A command based on a frame older than this is replaced by zero. With one slot of the link, the last
    motion is sent within 0.3 s of the last frame, whatever the policy's rate."""
    hold_after_s: Annotated[float, Range(0.02, 10)] = 0.5
    """A command older than this latches a stop: the robot holds."""
    disengage_after_s: Annotated[float, Range(0.02, 60)] = 1.5
    """A command older than this disengages: a base is disabled, a drone lands."""
    state_timeout_s: Annotated[float, Range(0.05, 5)] = 1.0
    """A stop latches when the robot has sent no measurement for this long. Adapters stop sooner; this is the
    backstop for one that does not."""
    fence_radius_m: Annotated[float, Range(1, 10_000)] = 100.0
    """The robot stays within a cylinder of this radius around where it was engaged."""
    fence_corners_m: tuple[tuple[_Offset, _Offset], ...] = ()
    """A polygon instead of the cylinder: its corners in order, each (ahead, left) of the robot's pose when it
    was engaged."""
    altitude_m: tuple[_Height, _Height] | None = None
    """Lowest and highest altitude of a flying robot above its take-off point; none for ground robots."""
    largest_target: Annotated[float, Range(0.01, 0.9)] = 0.3
    """Largest share of the image that the target's box may cover; beyond it the target is too close, and
    forward motion is cut, before it to what a stop leaves room for. 0.3 is a person 1.76 m tall and 0.49 m
    broad, about 0.8 m before a 90 degree lens."""
    largest_others: Annotated[float, Range(0.01, 0.9)] = 0.12
    """Largest share of the image that the masks of all other people may cover; beyond it forward motion is
    cut. 0.12 is one such person, about 1.25 m before a 90 degree lens."""
    headway_s: Annotated[float, Range(0.01, 5)] = 0.2
    """How late the body obeys, its lag and delay together. A stop takes speed times this and then
    ``v^2 / (2 accel_m_s2)``: forward speed is at most that whose stop fits into the room left to other
    people, and fence and altitude band allow for it."""
    passing_s: Annotated[float, Range(0.1, 10)] = 1.0
    """Forward motion stays cut, or as slow, for this long after other people were nearest: whoever has left
    the image that large is beside the robot."""
    battery_warn: Annotated[float, Range(0.01, 1)] = 0.2
    """State of charge below which a low battery is reported."""
    battery_stop: Annotated[float, Range(0.01, 1)] = 0.1
    """State of charge at which the robot disengages: a base is disabled, a drone lands."""
    switched_off: tuple[Dispensable, ...] = ()
    """Disabled limits. Every trial reports them, on the screen and in its log."""

    def __post_init__(self) -> None:
        if self.battery_warn < self.battery_stop:
            raise UsageError(
                f"limits: battery_warn {self.battery_warn:g} is below battery_stop {self.battery_stop:g}: "
                "the robot would stop before the warning"
            )
        if self.altitude_m is not None and not self.altitude_m[0] < self.altitude_m[1]:
            low, high = self.altitude_m
            raise UsageError(f"limits: altitude_m [{low:g}, {high:g}]: the lower comes first")
        if self.fence_corners_m and not encloses(self.fence_corners_m, 0.0, 0.0):
            raise UsageError(
                "limits: fence_corners_m: [0, 0], where the robot is engaged, is not inside the polygon"
            )

    def capped(self, share: float) -> Limits:
        """Return the limits with every speed and the yaw rate scaled by `share`, 0 to 1."""
        return replace(
            self,
            forward_m_s=share * self.forward_m_s,
            backward_m_s=share * self.backward_m_s,
            lateral_m_s=share * self.lateral_m_s,
            vertical_m_s=share * self.vertical_m_s,
            yaw_rate_rad_s=share * self.yaw_rate_rad_s,
        )


def encloses(corners: tuple[tuple[float, float], ...], x: float, y: float) -> bool:
    """Return whether a polygon contains a point, by counting the edges that a ray to +x crosses (even-odd
    rule).

    A point with NaN is in no polygon; a polygon of fewer than three corners contains nothing.
    """
    inside = False
    for (x1, y1), (x2, y2) in pairwise((*corners, *corners[:1])):
        if (y1 > y) != (y2 > y) and x < x1 + (y - y1) / (y2 - y1) * (x2 - x1):
            inside = not inside
    return inside
