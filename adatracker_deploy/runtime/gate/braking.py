"""How far a robot goes on after it is told to stop: its reaction and its braking.

Stopping distance: ``v * T + v^2 / (2 a)``, with the profile's headway T, the body's delay and lag together,
and its acceleration limit a, which is how hard the gate brakes. Tests hold every shipped profile to what its
simulated body needs.
"""

from __future__ import annotations

import math

from adatracker_deploy.config.limits import Limits


def stopping_s(limits: Limits, speed_m_s: float) -> float:
    """Return the stopping distance from a speed >= 0 m/s, divided by that speed, s."""
    return limits.headway_s + speed_m_s / (2 * limits.accel_m_s2)


def fastest_m_s(limits: Limits, room_m: float, age_s: float) -> float:
    """Return the highest speed at which a stop fits into a room, m/s; 0 without room.

    Args:
        limits: with the headway and the acceleration limit.
        room_m: that was left so long ago, m; may be infinite.
        age_s: >= 0; the robot has gone on since.
    """
    if not 0 < room_m < math.inf:
        return math.inf if room_m > 0 else 0.0
    reaction_s = limits.headway_s + age_s
    # of the two forms of the root, the one that does not cancel
    return 2 * room_m / (reaction_s + math.sqrt(reaction_s**2 + 2 * room_m / limits.accel_m_s2))
