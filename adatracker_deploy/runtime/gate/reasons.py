"""The name of everything for which a command is changed, a robot stopped or an operator warned."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from collections.abc import Iterable


class Kind(enum.Enum):
    """What a reason does to a command."""

    LIMITS = "limits"
    """The command is obeyed, within limits."""
    WITHHOLDS = "withholds"
    """The command, or its part that does harm, is zero until one comes that may pass."""
    STOPS = "stops"
    """The robot is stopped; only a new engage lets it move again."""
    WARNS = "warns"
    """Nothing is changed yet."""


class Reason(enum.StrEnum):
    """Why what was sent is not what was asked for; the names stand in status, logs and profiles."""

    kind: Kind

    def __new__(cls, name: str, kind: Kind) -> Self:
        """Make a member; one without a kind is an error when this module is imported."""
        reason = str.__new__(cls, name)
        reason._value_ = name
        reason.kind = kind
        return reason

    ENVELOPE = "envelope", Kind.LIMITS
    """Faster than the limits."""
    RAMP = "ramp", Kind.LIMITS
    """Faster than so soon after engaging."""
    TOO_CLOSE = "too_close", Kind.WITHHOLDS
    """Forward, with the target's box too large."""
    ALTITUDE = "altitude", Kind.WITHHOLDS
    """Towards the edge of the altitude band; or, as a stop, well outside it."""
    ACCELERATION = "acceleration", Kind.LIMITS
    JERK = "jerk", Kind.LIMITS
    STALE = "stale", Kind.WITHHOLDS
    """The command is too old: zero, until a fresh one comes."""
    BLIND = "blind", Kind.WITHHOLDS
    """What the command was made from was seen too long ago, or not yet: zero, until a newer frame comes."""

    COMMAND_LOST = "command_lost", Kind.STOPS
    """No fresh command for so long that a stop latched."""
    NOT_FINITE = "not_finite", Kind.STOPS
    """NaN or infinity was asked for."""
    GEOFENCE = "geofence", Kind.STOPS
    """The robot would come to rest outside its fence."""
    BATTERY = "battery", Kind.STOPS
    BATTERY_LOST = "battery_lost", Kind.STOPS
    """The robot told its charge, and does not any more."""
    POSITION_LOST = "position_lost", Kind.STOPS
    """The robot told its position, and does not any more."""
    POSITION_JUMPED = "position_jumped", Kind.STOPS
    """The position changed by more than motion explains: its estimate was reset, or is wrong."""
    STATE_LOST = "state_lost", Kind.STOPS
    """Nothing new was heard of the robot, or what it said is older than what it said before."""
    NOT_ENGAGED = "not_engaged", Kind.STOPS
    """The robot says that it no longer obeys."""
    ROBOT_STOPPED = "robot_stopped", Kind.STOPS
    """The robot, or its adapter, latched a stop."""
    TAKEOVER = "takeover", Kind.STOPS
    """Somebody else has control."""
    REFUSED = "refused", Kind.STOPS
    """The adapter could not send."""
    SUSPENDED = "suspended", Kind.STOPS
    """The machine slept."""
    ASKED = "asked", Kind.STOPS
    """The operator, or the end of the trial."""

    BATTERY_LOW = "battery_low", Kind.WARNS
    """A warning: nothing is changed yet."""


def limited(names: Iterable[str]) -> bool:
    """Tell whether a logged command was changed to keep it within limits."""
    return any(name in _LIMITS for name in names)


def withheld(names: Iterable[str]) -> bool:
    """Tell whether a logged command was withheld, or the robot stopped; a name not known here counts so."""
    return any(name not in _LIMITS | _WARNS for name in names)


_LIMITS = frozenset(reason.value for reason in Reason if reason.kind is Kind.LIMITS)
_WARNS = frozenset(reason.value for reason in Reason if reason.kind is Kind.WARNS)
