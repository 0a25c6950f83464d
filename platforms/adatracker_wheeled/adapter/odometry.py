"""Wheel odometry: pure integration, no I/O."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from adatracker_deploy.core.geometry import Pose, wrap_angle
from adatracker_deploy.core.messages import Twist

LONGEST_STEP_S = 0.5
"""Nothing is known of what happened in a longer silence, and nothing is guessed: the pose stays."""
_BUNCH_S = 0.1
"""Frames are stamped when they arrive: held up, they come together, and each may tell of so much time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DeadReckoning:
    """A pose that starts at the origin and drifts; each step returns the next one.

    Feed it wheel distances with `rolled` or velocities with `moved`, not both.
    """

    track_m: float | None = None
    """Between the wheels; needed for `rolled`."""
    wrap_m: float | None = None
    """Distance, m, after which the wheels' counters start over."""
    fastest_m_s: float = 10.0
    """A wheel that rolled faster than this did not: the base was switched off and on, and counts anew."""
    longest_step_s: float = LONGEST_STEP_S
    """Longest time step, in the clock of the readings' times."""
    pose: Pose = field(default_factory=Pose)
    wheels_m: tuple[float, float] | None = None
    t_ns: int | None = None

    def rolled(self, wheels_m: tuple[float, float], t_ns: int) -> DeadReckoning:
        """Take the left and the right wheel's distance since power-on, m, at `t_ns`."""
        step = replace(self, wheels_m=wheels_m, t_ns=t_ns)
        elapsed_s = self._elapsed_s(t_ns)
        if self.wheels_m is None or self.track_m is None or elapsed_s > self.longest_step_s:
            return step
        left, right = (
            self._unwrapped(now - before) for now, before in zip(wheels_m, self.wheels_m, strict=True)
        )
        if max(abs(left), abs(right)) > self.fastest_m_s * max(elapsed_s, _BUNCH_S):
            return step
        return replace(step, pose=_advance(self.pose, (left + right) / 2, 0.0, (right - left) / self.track_m))

    def moved(self, velocity: Twist, t_ns: int) -> DeadReckoning:
        """Take a body velocity that has held since the last step."""
        step = replace(self, t_ns=t_ns)
        elapsed_s = self._elapsed_s(t_ns)
        if not 0 < elapsed_s <= self.longest_step_s:
            return step
        forward, left, turned = (rate * elapsed_s for rate in (velocity.vx, velocity.vy, velocity.yaw_rate))
        return replace(step, pose=_advance(self.pose, forward, left, turned))

    def _elapsed_s(self, t_ns: int) -> float:
        """Return the time since the last step; 0 at the first."""
        return 0.0 if self.t_ns is None else (t_ns - self.t_ns) / 1e9

    def _unwrapped(self, difference_m: float) -> float:
        return difference_m if self.wrap_m is None else math.remainder(difference_m, self.wrap_m)


def _advance(pose: Pose, forward_m: float, left_m: float, turned_rad: float) -> Pose:
    """Move along a circular arc: its chord lies at half the turn (exact while velocities are constant)."""
    half = turned_rad / 2
    chord = math.sin(half) / half if half else 1.0
    c, s = math.cos(pose.yaw + half) * chord, math.sin(pose.yaw + half) * chord
    return replace(
        pose,
        x=pose.x + c * forward_m - s * left_m,
        y=pose.y + s * forward_m + c * left_m,
        yaw=wrap_angle(pose.yaw + turned_rad),
    )
