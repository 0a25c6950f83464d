"""Walking paths: an S-shaped course as in the paper's field trials, or random walks as in its simulation.

Two random walkers are harder: one makes U-turns, another crosses the line of sight.

A walker knows its position and takes steps; the caller gives its `Clearance` at each step, so that a robot or
another person can be in the way. A walker never steps to a point with less clearance than `BERTH_M`, except
out of a narrower one.
"""

from __future__ import annotations

import math
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.geometry import wrap_angle
from adatracker_deploy.sim.footprint import Clearance, Points
from adatracker_deploy.sim.scene import Lap

PathName = Literal["s_path", "random_walk", "u_turns", "still"]

BERTH_M = 0.6
"""Smallest distance from a person's centre to anything, m."""

TURN_RATE_RAD_S = math.radians(120.0)
"""Turn rate of a person on a random walk."""


class Walker(Protocol):
    """A pedestrian seen from above; m and rad in the scene's frame."""

    x: float
    y: float
    heading: float

    def step(self, dt_s: float, clearance: Clearance) -> None:
        """Walk for `dt_s` seconds where there is room."""


class Still:
    """A walker that stands still."""

    def __init__(self, x: float, y: float, heading: float) -> None:
        """Stand at a point."""
        self.x, self.y, self.heading = x, y, heading

    def step(self, dt_s: float, clearance: Clearance) -> None:
        """Stay."""


class SPath:
    """Follows a closed course at constant speed; waits while blocked."""

    def __init__(self, course: Points, speed_m_s: float, start_m: float) -> None:
        """Take a course from `lap_course`, and start `start_m` along it."""
        closed = np.vstack([course, course[:1]])
        steps = np.diff(closed, axis=0)
        self._along = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])
        self._x, self._y = closed.T.copy()
        # The midpoint of a chord has the chord's direction; unwrapped for interpolation.
        self._middle = (self._along[1:] + self._along[:-1]) / 2
        self._direction = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        self._turn = round((self._direction[-1] - self._direction[0]) / math.tau) * math.tau
        self._speed = speed_m_s
        self._s = start_m % self.length_m
        self.x, self.y = self._place(self._s)
        self.heading = self._heading(self._s)

    @property
    def length_m(self) -> float:
        """Length of one lap."""
        return float(self._along[-1])

    def step(self, dt_s: float, clearance: Clearance) -> None:
        """Walk along the course."""
        s = (self._s + self._speed * dt_s) % self.length_m
        x, y = self._place(s)
        if not _has_room(clearance, (self.x, self.y), (x, y)):
            return
        self._s, self.x, self.y, self.heading = s, x, y, self._heading(s)

    def _place(self, s: float) -> tuple[float, float]:
        return float(np.interp(s, self._along, self._x)), float(np.interp(s, self._along, self._y))

    def _heading(self, s: float) -> float:
        period = self.length_m
        middle = np.concatenate([self._middle[-1:] - period, self._middle, self._middle[:1] + period])
        direction = np.concatenate(
            [self._direction[-1:] - self._turn, self._direction, self._direction[:1] + self._turn]
        )
        return wrap_angle(float(np.interp(s, middle, direction)))


class RandomWalk:
    """Walks to successive random goals, turning no faster than `TURN_RATE_RAD_S`.

    It keeps its speed while turning, as the paper's simulated people do, and turns on the spot only where
    there is no room for the arc.
    """

    def __init__(
        self, x: float, y: float, heading: float, *, speed_m_s: float, rng: np.random.Generator
    ) -> None:
        """Start at a point, without a goal."""
        self.x, self.y, self.heading = x, y, heading
        self._speed = speed_m_s
        self._rng = rng
        self._goal: tuple[float, float] | None = None

    def step(self, dt_s: float, clearance: Clearance) -> None:
        """Turn towards the goal and walk."""
        if self._goal is None or math.dist(self._goal, (self.x, self.y)) < max(0.5, self._speed * dt_s):
            self._goal = self._new_goal(clearance)
        if self._goal is None:
            return
        error = wrap_angle(math.atan2(self._goal[1] - self.y, self._goal[0] - self.x) - self.heading)
        most = TURN_RATE_RAD_S * dt_s
        self.heading = wrap_angle(self.heading + max(-most, min(most, error)))
        there = (
            self.x + self._speed * dt_s * math.cos(self.heading),
            self.y + self._speed * dt_s * math.sin(self.heading),
        )
        if _has_room(clearance, (self.x, self.y), there):
            self.x, self.y = there
        elif abs(error) <= most:
            self._goal = None

    def _new_goal(
        self, clearance: Clearance, ahead_rad: float = 0.0, spread_rad: float = math.pi
    ) -> tuple[float, float] | None:
        """Return the first of 24 random points 3 to 10 m away with a free straight path, if any.

        If none is free, return the furthest free point on the longest free path.

        Args:
            clearance: the free space.
            ahead_rad: the centre of the search directions.
            spread_rad: largest deviation from it.
        """
        here = np.array([self.x, self.y])
        bearing = ahead_rad + self._rng.uniform(-spread_rad, spread_rad, 24)
        distance = self._rng.uniform(3.0, 10.0, 24)
        reach = np.linspace(0.0, 1.0, 41)[1:]
        along = distance[:, None] * reach
        way = here + along[..., None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)[:, None, :]
        needed = min(BERTH_M, float(clearance(here[None])[0]))
        free = (clearance(way.reshape(-1, 2)) >= needed).reshape(along.shape)
        steps = np.where(free.all(axis=1), len(reach), free.argmin(axis=1))
        best = int(steps.argmax())
        if steps[best] == 0:
            return None
        return float(way[best, steps[best] - 1, 0]), float(way[best, steps[best] - 1, 1])


class UTurnWalk(RandomWalk):
    """A random walk with a U-turn every few seconds, back past the follower."""

    _MEAN_S = 7.0
    _SPREAD_RAD = math.radians(25.0)

    def step(self, dt_s: float, clearance: Clearance) -> None:
        """Turn round at times, then walk."""
        if self._rng.random() < dt_s / self._MEAN_S:
            self._goal = self._new_goal(clearance, self.heading + math.pi, self._SPREAD_RAD)
        super().step(dt_s, clearance)


class Crosser(RandomWalk):
    """A random walk that at times enters somebody's line of sight for a while."""

    _MEAN_S = 6.0
    """Mean time between two crossings."""
    _MOOD_S = (2.0, 7.0)

    _left_s = 0.0

    def meet(self, eye: tuple[float, float], target: tuple[float, float], dt_s: float) -> None:
        """While crossing, head for the midpoint between a camera and its target."""
        self._left_s -= dt_s
        if self._left_s <= 0.0 and self._rng.random() < dt_s / self._MEAN_S:
            self._left_s = float(self._rng.uniform(*self._MOOD_S))
        if self._left_s > 0.0:
            self._goal = (eye[0] + target[0]) / 2, (eye[1] + target[1]) / 2


def _has_room(clearance: Clearance, here: tuple[float, float], there: tuple[float, float]) -> bool:
    now, then = clearance(np.array([here, there]))
    return bool(then >= BERTH_M or then > now)


def lap_course(lap: Lap, spacing_m: float = 0.05) -> Points:
    """Return points along a closed S-shaped lap around the origin, counter-clockwise, shape (N, 2), m.

    A stadium's outline r(s) plus `weave_m` sin(2 pi `waves` s / length) along its outward normal.
    """
    arc = math.pi * lap.radius_m
    length = 2.0 * (lap.straight_m + arc)
    s = np.linspace(0.0, length, round(length / spacing_m), endpoint=False)
    half = s % (length / 2.0)
    turned = np.clip((half - lap.straight_m) / lap.radius_m, 0.0, math.pi)
    normal = np.where(s < length / 2.0, 0.0, math.pi) + turned - math.pi / 2
    centre_x = np.minimum(half, lap.straight_m) - lap.straight_m / 2
    sign = np.where(s < length / 2.0, 1.0, -1.0)
    out = lap.radius_m + lap.weave_m * np.sin(math.tau * lap.waves * s / length)
    course: NDArray[np.float64] = np.stack(
        [sign * centre_x + out * np.cos(normal), out * np.sin(normal)], axis=-1
    )
    return course
