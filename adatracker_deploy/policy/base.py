"""The policy interface, and the conversion of an action to a velocity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.messages import Twist

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from adatracker_deploy.core.messages import Action, Observation

STALE_OBSERVATION_S = 0.22
"""An older observation is not acted on: zero is sent, and the step is stale. Machine time.

The robot then brakes as smoothly as it drives, until the gate, which knows when the frame was taken, makes
it zero at once (`Limits.sight_timeout_s`). A segmenter or a server that takes 0.1 s can still be followed."""

Axis = Literal["forward", "lateral", "vertical", "yaw"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ActionAxis:
    """One number of an action: a fraction of the robot's limit on that axis, or a velocity."""

    axis: Axis
    sign: Literal[-1, 1] = 1
    """+1 where positive means forward, left, up, counter-clockwise (REP 103); -1 where it is the reverse."""
    unit: Literal["limit", "si"] = "limit"
    """A fraction of the limit, in [-1, 1]; or m/s, and rad/s of yaw, whatever the robot is."""


ActionSpec = tuple[ActionAxis, ...]
"""The order and signs of an action's numbers."""

FORWARD_YAW: ActionSpec = (ActionAxis(axis="forward"), ActionAxis(axis="yaw"))


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicyInfo:
    """The facts about a policy that the loop and the log need."""

    name: str
    rate_hz: float
    """The rate it was trained at, and is run at."""
    action: ActionSpec
    sha256: tuple[tuple[str, str], ...] = ()
    """(file, digest) of everything it was loaded from."""
    source: str = ""
    """Its address and commit on the Hub; empty for one of this machine."""
    server: str = ""
    """The address of the machine that it runs on; empty for this process."""
    runs_on: str = ""
    """The execution provider that its network was granted, as in ``cpu``; empty for one without a network."""


class NoAnswer(Exception):  # noqa: N818 -- not an error: the robot stands still meanwhile
    """A policy on another machine has not answered yet."""


class Policy(Protocol):
    """Maps observations to actions, one after the other."""

    @property
    def info(self) -> PolicyInfo:
        """Describe the policy."""

    def reset(self, seed: int = 0) -> None:
        """Forget everything: a new episode begins."""

    def act(self, observation: Observation) -> Action:
        """Answer one observation; called once a tick, at `info.rate_hz`.

        Raises:
            NoAnswer: there is none yet; only policies elsewhere are late.
            PlatformError: its server is gone, or answers an invalid action.
        """


def to_twist(values: NDArray[np.floating[Any]], spec: ActionSpec, limits: Limits) -> Twist:
    """Turn an action into a velocity: each number times the robot's limit on its axis, or itself.

    Beyond the robot's limit it is clipped; NaN and infinity are kept for the gate to refuse.
    """
    most = {
        "forward": limits.forward_m_s,
        "lateral": limits.lateral_m_s,
        "vertical": limits.vertical_m_s,
        "yaw": limits.yaw_rate_rad_s,
    }
    named = {
        entry.axis: _velocity(float(value), most[entry.axis], entry)
        for entry, value in zip(spec, values, strict=True)
    }
    return Twist(
        vx=named.get("forward", 0.0),
        vy=named.get("lateral", 0.0),
        vz=named.get("vertical", 0.0),
        yaw_rate=named.get("yaw", 0.0),
    )


def _velocity(value: float, most: float, entry: ActionAxis) -> float:
    if not np.isfinite(value):
        return np.nan
    asked = value if entry.unit == "si" else value * most
    return entry.sign * float(np.clip(asked, -most, most))
