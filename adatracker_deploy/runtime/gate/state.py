"""The gate's input, output and state."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_deploy.runtime.gate.reasons import Reason
from adatracker_deploy.runtime.gate.track import Track


class Stage(enum.IntEnum):
    """Escalation stages of the gate; each includes the ones before."""

    OBEY = 0
    ZERO = 1
    """No fresh command: send zero until one comes."""
    HOLD = 2
    """Latched: hold."""
    DISENGAGE = 3
    """Latched: disengage in the robot's safe way; a base is disabled, a drone lands."""


@dataclass(frozen=True, slots=True)
class Setpoint:
    """A velocity requested at clock time `t_ns`."""

    twist: Twist
    t_ns: int
    target_share: float | None = None
    """The share of the image that the target covers, as `Box.covered` counts, 0 to 1; None while it is not
    seen."""
    seen_ns: int | None = None
    """Capture time of the frame it is based on; None for a command not based on a frame."""
    held_until_ns: int | None = None
    """When the dead-man button no longer counts as held; None where no such button limits the command."""
    others_share: float | None = None
    """The share of the image that other people cover, as `covered` counts, 0 to 1; None where no image
    tells."""


@dataclass(frozen=True, slots=True)
class Stop:
    """A stop that has latched."""

    reason: Reason
    told: str = ""
    """The robot's or operator's own words; empty if the reason's name is enough."""
    stage: Stage = Stage.HOLD

    @property
    def text(self) -> str:
        """The stop in words for people."""
        return self.told or self.reason


@dataclass(frozen=True, slots=True)
class GateState:
    """The gate's memory between two commands; only an engage makes a new one."""

    armed_ns: int
    """Time of arming; older set-points are ignored."""
    last: Twist = ZERO
    rate: Twist = ZERO
    """The rate of change of `last`: accelerations, m/s^2 and rad/s^2."""
    last_ns: int = 0
    moving_ns: int | None = None
    """Time of the first request for motion; None before."""
    start: Pose | None = None
    """The robot's first reported pose; None while it reports no position."""
    track: Track | None = None
    """The position that motion can explain; None while the robot reports no position."""
    heard_ns: int = 0
    """Time of the robot's newest measurement."""
    battery_told: bool = False
    """The robot has reported its battery charge."""
    target_m: float = math.inf
    """How far away the target was when it was last seen, m; infinite before."""
    others_m: float = math.inf
    """How far away other people were when they were nearest of late, m; infinite where nobody was seen."""
    others_ns: int = 0
    """When that was."""
    seen_ns: int = 0
    """Capture time of the newest picture in which people were looked for; 0 before the first."""
    stop: Stop | None = None
    """The latched stop; None without one."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The command sent, and the reasons it differs from the request."""

    twist: Twist
    stage: Stage
    reasons: tuple[Reason, ...] = ()
    warnings: tuple[Reason, ...] = ()
    """Reasons that are about to apply."""
