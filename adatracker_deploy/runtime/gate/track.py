"""Detects position jumps: a reset of the estimate moves the fence, not the robot.

The frame of odometry is continuous: a pose in it "evolves smoothly, without discrete jumps" (REP 105). Real
estimators still correct themselves, so a jump is what neither motion nor such a correction explains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.geometry import Pose

JUMP_M = 1.0
"""Largest jump, m, of the reported position beyond the motion. PX4's height, the worst measured, was
wrong by at most 0.84 m and drifts; no fence is narrower than 1 m."""
DRIFT_M_S = 1.0
"""Margin of an estimate's speed over the robot's limit. PX4's velocity was wrong by at most 0.8
m/s (v1.16, simulated quadrotor)."""

Place = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Track:
    """A point that follows the reported position no faster than the robot can move."""

    reached: Place
    """Its position in the robot's own fixed frame, m."""
    reported: Place
    """The newest reported position."""
    reported_ns: int
    """Time at which that position was first judged."""

    @property
    def jumped(self) -> bool:
        """Whether the reported position is further away than motion and an estimator's corrections
        explain."""
        return math.dist(self.reached, self.reported) > JUMP_M


def fastest_m_s(limits: Limits) -> float:
    """Return the largest speed at which a valid estimate may move."""
    level = max(limits.forward_m_s, limits.backward_m_s)
    return math.hypot(level, limits.lateral_m_s, limits.vertical_m_s) + DRIFT_M_S


def follow(limits: Limits, track: Track | None, pose: Pose | None, now_ns: int) -> Track | None:
    """Move the track towards a newly reported position.

    Positions arrive less often than commands are sent. So the time step is the time since the previous
    position was first judged, at most `state_timeout_s`.

    Args:
        limits: the profile's, with its time-outs in the run's clock.
        track: the last; None before the first position.
        pose: the newest; None, or one that is not finite, moves nothing.
        now_ns: the run's clock.
    """
    place = (pose.x, pose.y, pose.z) if pose is not None else (math.nan,) * 3
    if not all(map(math.isfinite, place)):
        return track
    if track is None:
        return Track(place, place, now_ns)
    if place == track.reported:
        return track
    had_s = min((now_ns - track.reported_ns) / 1e9, limits.state_timeout_s)
    reach_m, away_m = fastest_m_s(limits) * had_s, math.dist(track.reached, place)
    if away_m <= reach_m:
        return Track(place, place, now_ns)
    x, y, z = (a + (b - a) * (reach_m / away_m) for a, b in zip(track.reached, place, strict=True))
    return Track((x, y, z), place, now_ns)
