"""What goes into the gate, what comes out, and what it remembers in between."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_deploy.runtime.gate.reasons import Reason
from adatracker_deploy.runtime.gate.track import Track


class Stage(enum.IntEnum):
    """How far the gate has gone from obeying; each stage includes the ones before."""

    OBEY = 0
    ZERO = 1
    """No fresh command: send zero, obey again when one comes."""
    HOLD = 2
    """Latched: hold."""
    DISENGAGE = 3
    """Latched, and to be given up in the robot's safe way: a base is disabled, a drone lands."""


@dataclass(frozen=True, slots=True)
class Setpoint:
    """A velocity that somebody asked for at clock time `t_ns`."""

    twist: Twist
    t_ns: int
    target_share: float | None = None
    """The share of the image that the target's box covers, 0 to 1; None while it is not seen."""
    seen_ns: int | None = None
    """When the frame was taken that it was made from; None for a command that nothing seen has led to."""


@dataclass(frozen=True, slots=True)
class Stop:
    """A stop that has latched."""

    reason: Reason
    told: str = ""
    """What the robot or the operator said; empty where the reason's name says it all."""
    stage: Stage = Stage.HOLD

    @property
    def text(self) -> str:
        """What people are told."""
        return self.told or self.reason


@dataclass(frozen=True, slots=True)
class GateState:
    """What the gate remembers between two commands; every engage makes a new one, and nothing else does."""

    armed_ns: int
    """When it was armed: older set-points do not count."""
    last: Twist = ZERO
    rate: Twist = ZERO
    """The rate of change of `last`: accelerations, m/s^2 and rad/s^2."""
    last_ns: int = 0
    moving_ns: int | None = None
    """When motion was first asked for; None before."""
    start: Pose | None = None
    """Where the robot was first seen to be; None while it tells no position."""
    track: Track | None = None
    """Where it can have come to by motion; None while it tells no position."""
    heard_ns: int = 0
    """When the newest was measured that the robot has told."""
    battery_told: bool = False
    """It has told its charge."""
    close: bool = False
    """The target was too close when it was last seen."""
    stop: Stop | None = None
    """What has latched; None while nothing has."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What goes to the wire, and why it differs from what was asked."""

    twist: Twist
    stage: Stage
    reasons: tuple[Reason, ...] = ()
    warnings: tuple[Reason, ...] = ()
    """What is about to change something."""
