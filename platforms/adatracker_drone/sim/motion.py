"""The vehicle's motion in the frames of flight dynamics and PX4: north-east-down, forward-right-down."""

from __future__ import annotations

from typing import NamedTuple

HOME_LATITUDE_DEG, HOME_LONGITUDE_DEG, HOME_ALTITUDE_M = 47.397742, 8.545594, 488.0
"""Position of the start on Earth: the home of PX4's own simulators."""


class Motion(NamedTuple):
    """One instant. A named tuple, because 250 of them are made a second.

    Places in m from the start on the ground, speeds in m/s, angles in rad, rates in rad/s.
    """

    north: float = 0.0
    east: float = 0.0
    down: float = 0.0
    v_north: float = 0.0
    v_east: float = 0.0
    v_down: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    """Positive is nose up."""
    heading: float = 0.0
    """Clockwise from north, in (-pi, pi]."""
    p: float = 0.0
    """Roll rate, about forward."""
    q: float = 0.0
    """Pitch rate, about right."""
    r: float = 0.0
    """Yaw rate, about down: clockwise."""
    on_gear: bool = False
    """A foot of the gear touches the ground."""

    @property
    def altitude(self) -> float:
        """Height above the start, m."""
        return -self.down


class Velocity(NamedTuple):
    """A velocity demand in the level frame that turns with the heading, m/s and rad/s."""

    forward: float = 0.0
    right: float = 0.0
    down: float = 0.0
    yaw_rate: float = 0.0
    """Clockwise."""
