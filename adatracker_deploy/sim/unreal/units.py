"""The engine's frame and units: the one place where they change. Pure.

Unreal counts centimetres and degrees in a left-handed frame: x forward, y right, z up; a positive yaw turns
right (clockwise from above), a positive pitch lifts the nose, a positive roll lowers the right side (Unreal
Engine's documentation of `FRotator`). The toolkit's frames are REP 103's (`core.geometry`).
"""

from __future__ import annotations

import math

from adatracker_deploy.core.geometry import Pose

CM = 100.0
_SAME = 0.00051
"""Two readings this near are the same, cm or degrees: UnrealCV prints `%.3f` (`StrFormatter.h`)."""

Triple = tuple[float, float, float]


def to_location(pose: Pose) -> Triple:
    """Return a pose's place in the engine's frame: x, y, z, cm."""
    return pose.x * CM, -pose.y * CM, pose.z * CM


def to_rotation(pose: Pose) -> Triple:
    """Return a pose's orientation as the engine orders it: pitch, yaw, roll, degrees."""
    return -math.degrees(pose.pitch), -math.degrees(pose.yaw), math.degrees(pose.roll)


def to_pose(location: Triple, rotation: Triple) -> Pose:
    """Return the pose of a location and a rotation in the engine's frame."""
    (x, y, z), (pitch, yaw, roll) = location, rotation
    return Pose(x / CM, -y / CM, z / CM, math.radians(roll), -math.radians(pitch), -math.radians(yaw))


def kept(asked: Triple, read: Triple, period: float = math.inf) -> Triple:
    """Return what was asked for where the engine's rounded answer is the same, else the answer.

    Args:
        asked: as it was sent.
        read: as it came back.
        period: 360 for angles, which the engine winds up.
    """
    x, y, z = (
        one if abs(math.remainder(one - other, period)) <= _SAME else other
        for one, other in zip(asked, read, strict=True)
    )
    return x, y, z


def numbers(values: Triple) -> str:
    """Return three numbers as a command takes them: its pattern of a number has no exponent."""
    return " ".join(f"{value:.12f}" for value in values)


def read_triple(text: str) -> Triple:
    """Read three numbers.

    Raises:
        ValueError: the text is something else.
    """
    x, y, z = map(float, text.split())
    if not all(map(math.isfinite, (x, y, z))):
        raise ValueError(f"not finite: {text}")
    return x, y, z
