"""The policy interface, and the conversion of an action to a velocity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.messages import Twist

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from adatracker_deploy.core.messages import Action, Observation

Axis = Literal["forward", "lateral", "vertical", "yaw"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ActionAxis:
    """One number of an action: a fraction of the robot's limit on that axis."""

    axis: Axis
    sign: Literal[-1, 1] = 1
    """+1 where positive means forward, left, up, counter-clockwise (REP 103); -1 where it is the reverse."""


ActionSpec = tuple[ActionAxis, ...]
"""The order and signs of an action's numbers."""

FORWARD_YAW: ActionSpec = (ActionAxis(axis="forward"), ActionAxis(axis="yaw"))


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicyInfo:
    """What the loop and the log need to know of a policy."""

    name: str
    rate_hz: float
    """The rate it was trained at, and is run at."""
    action: ActionSpec
    sha256: tuple[tuple[str, str], ...] = ()
    """(file, digest) of everything it was loaded from."""


class Policy(Protocol):
    """Maps observations to actions, one after the other."""

    @property
    def info(self) -> PolicyInfo:
        """Describe the policy."""

    def reset(self, seed: int = 0) -> None:
        """Forget everything: a new episode begins."""

    def act(self, observation: Observation) -> Action:
        """Answer one observation; called once a tick, at `info.rate_hz`."""


def to_twist(values: NDArray[np.float32], spec: ActionSpec, limits: Limits) -> Twist:
    """Turn an action into a velocity: each number times the robot's limit on its axis.

    Numbers beyond [-1, 1] are clipped; NaN and infinity are kept for the gate to refuse.
    """
    scale = {
        "forward": limits.forward_m_s,
        "lateral": limits.lateral_m_s,
        "vertical": limits.vertical_m_s,
        "yaw": limits.yaw_rate_rad_s,
    }
    named = {
        entry.axis: (float(np.clip(value, -1.0, 1.0)) if np.isfinite(value) else np.nan)
        * entry.sign
        * scale[entry.axis]
        for entry, value in zip(spec, values, strict=True)
    }
    return Twist(
        vx=named.get("forward", 0.0),
        vy=named.get("lateral", 0.0),
        vz=named.get("vertical", 0.0),
        yaw_rate=named.get("yaw", 0.0),
    )
