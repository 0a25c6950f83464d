"""A walking person: limbs as capsules and ellipsoids, swung by the distance walked.

Segment lengths are fractions of body height after Drillis and Contini (1966), as printed in D. A. Winter,
"Biomechanics and Motor Control of Human Movement". The gait looks plausible but is not a biomechanical model:
thighs swing as a sine, a knee bends while its leg swings forward, arms swing against the legs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

HEIGHT_M = 1.75
_THIGH = 0.245 * HEIGHT_M
_SHANK = 0.246 * HEIGHT_M
_ANKLE = 0.039 * HEIGHT_M
_HIP = _THIGH + _SHANK + _ANKLE
_SHOULDER = 0.818 * HEIGHT_M - 0.04  # the centre of a rounded shoulder
_UPPER_ARM = 0.186 * HEIGHT_M
_FOREARM = 0.20 * HEIGHT_M
_HIP_HALF_WIDTH = 0.095
_SHOULDER_HALF_WIDTH = 0.215
_FOOT_HALF_HEIGHT = 0.045
_SEATED_RAD = math.radians(88.0)
"""Angle of the thighs of somebody who sits, as in the shipped people's animation."""

Point = tuple[float, float, float]
Role = Literal["skin", "hair", "shirt", "trousers", "shoes"]


@dataclass(frozen=True, slots=True)
class Limb:
    """One primitive of a person, and its colour."""

    shape: Literal["capsule", "ellipsoid"]
    half: tuple[float, float, float]
    """Ellipsoid: half-widths. Capsule: radius, radius, half the distance between its ends' centres. All m."""
    role: Role


_TRUNK = (
    (Limb("ellipsoid", (0.095, 0.078, 0.115), "skin"), (0.01, 0.0, 1.635)),
    (Limb("ellipsoid", (0.098, 0.083, 0.085), "hair"), (-0.02, 0.0, 1.675)),
    (Limb("capsule", (0.052, 0.052, 0.05), "skin"), (0.0, 0.0, 1.50)),
    (Limb("ellipsoid", (0.120, 0.200, 0.300), "shirt"), (0.0, 0.0, 1.215)),
    (Limb("ellipsoid", (0.118, 0.170, 0.150), "trousers"), (0.0, 0.0, 0.94)),
)
_SIDE = (
    Limb("capsule", (0.048, 0.048, _UPPER_ARM / 2), "shirt"),
    Limb("capsule", (0.038, 0.038, _FOREARM / 2), "skin"),
    Limb("capsule", (0.078, 0.078, _THIGH / 2), "trousers"),
    Limb("capsule", (0.054, 0.054, _SHANK / 2), "trousers"),
    Limb("ellipsoid", (0.135, 0.050, _FOOT_HALF_HEIGHT), "shoes"),
)
LIMBS: tuple[Limb, ...] = tuple(limb for limb, _ in _TRUNK) + _SIDE + _SIDE
"""Every limb, in the order that `posture` places them: trunk from the head down, left side, right side."""


@dataclass(slots=True)
class Gait:
    """A person's gait phase."""

    phase_rad: float = 0.0
    """0 to 2 pi over two steps."""
    speed_m_s: float = 0.0
    """Smoothed speed; the swing grows with it and is zero at rest."""
    walked_m: float = 0.0
    """Distance walked in all."""
    seated: float = 0.0
    """Share of the time that sitting down takes, 0 (up) to 1."""

    def walk(self, distance_m: float, dt_s: float) -> None:
        """Advance by `distance_m` in `dt_s` > 0 seconds.

        Two steps cover 1.4 m at 1 m/s, and more at higher speed.
        """
        speed = distance_m / dt_s
        self.walked_m += distance_m
        self.speed_m_s += (speed - self.speed_m_s) * (1.0 - math.exp(-dt_s / 0.2))
        self.phase_rad = (self.phase_rad + math.tau * distance_m / (0.9 + 0.5 * speed)) % math.tau


def posture(gait: Gait) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the limbs' centres (L, 3), m, and pitch angles (L,), rad, in the person's frame.

    The frame's origin is on the ground under the hips, x forward, z up; the lower foot stands on it. A limb's
    own z axis is turned by Ry(pitch).
    """
    effort = min(1.0, gait.speed_m_s / 0.8)
    swing = effort * min(0.75, 0.28 + 0.13 * gait.speed_m_s)
    bend = effort * min(1.3, 0.7 + 0.2 * gait.speed_m_s)
    seated = _SEATED_RAD * (0.5 - 0.5 * math.cos(math.pi * gait.seated))
    legs = [
        (thigh + seated, shank)
        for thigh, shank in (_leg(gait.phase_rad + turn, swing, bend) for turn in (0.0, math.pi))
    ]
    hip = max(_THIGH * math.cos(thigh) + _SHANK * math.cos(shank) for thigh, shank in legs) + _ANKLE
    drop = hip - _HIP
    centres = [(x, y, z + drop) for _, (x, y, z) in _TRUNK]
    pitches = [0.0] * len(_TRUNK)
    for side, (thigh, shank) in zip((1.0, -1.0), legs, strict=True):
        upper = -0.8 * thigh
        fore = upper + 0.15 + 0.5 * swing
        elbow, upper_middle = _hang((0.0, side * _SHOULDER_HALF_WIDTH, _SHOULDER + drop), upper, _UPPER_ARM)
        _, fore_middle = _hang(elbow, fore, _FOREARM)
        knee, thigh_middle = _hang((0.0, side * _HIP_HALF_WIDTH, hip), thigh, _THIGH)
        ankle, shank_middle = _hang(knee, shank, _SHANK)
        foot = (ankle[0] + 0.06, ankle[1], ankle[2] - _ANKLE + _FOOT_HALF_HEIGHT)
        centres += [upper_middle, fore_middle, thigh_middle, shank_middle, foot]
        pitches += [-upper, -fore, -thigh, -shank, 0.0]
    return np.array(centres), np.array(pitches)


def _leg(phase: float, swing: float, bend: float) -> tuple[float, float]:
    """Return the thigh's and the shank's angle from straight down, positive forward, rad."""
    thigh = swing * math.sin(phase)
    return thigh, thigh - bend * max(0.0, math.cos(phase)) ** 2


def _hang(joint: Point, angle: float, length: float) -> tuple[Point, Point]:
    """Return the free end and the centre of a limb that hangs from `joint` at an angle from straight down."""
    x, y, z = joint
    along, down = length * math.sin(angle), length * math.cos(angle)
    return (x + along, y, z - down), (x + along / 2, y, z - down / 2)
