"""Every reason to change a command, stop the robot or warn the operator."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from collections.abc import Iterable


class Kind(enum.Enum):
    """The effect of a reason on a command."""

    LIMITS = "limits"
    """The command is followed, within limits."""
    WITHHOLDS = "withholds"
    """The command, or its harmful part, is zero until a permitted one comes."""
    STOPS = "stops"
    """The robot is stopped; only a new engage allows motion."""
    WARNS = "warns"
    """Nothing is changed yet."""


class Reason(enum.StrEnum):
    """Reasons for changing the requested command; the names appear in status, logs and profiles."""

    kind: Kind

    def __new__(cls, name: str, kind: Kind) -> Self:
        """Create a member; a member without a kind fails at import."""
        reason = str.__new__(cls, name)
        reason._value_ = name
        reason.kind = kind
        return reason

    ENVELOPE = "envelope", Kind.LIMITS
    """Faster than the limits."""
    RAMP = "ramp", Kind.LIMITS
    """Faster than the ramp after engaging allows."""
    TOO_CLOSE = "too_close", Kind.WITHHOLDS
    """Forward motion while the target's box is too large."""
    ALTITUDE = "altitude", Kind.WITHHOLDS
    """Motion towards the edge of the altitude band; as a stop: well outside it."""
    ACCELERATION = "acceleration", Kind.LIMITS
    JERK = "jerk", Kind.LIMITS
    STALE = "stale", Kind.WITHHOLDS
    """The command is too old: zero, until a fresh one comes."""
    BLIND = "blind", Kind.WITHHOLDS
    """The frame that the command is based on is too old, or missing: zero, until a newer frame comes."""
    DEAD_MAN = "dead_man", Kind.WITHHOLDS
    """The dead-man button is not held while driving by hand: zero, until it is held again."""

    COMMAND_LOST = "command_lost", Kind.STOPS
    """No fresh command within the time-out: a stop latched."""
    NOT_FINITE = "not_finite", Kind.STOPS
    """The command holds NaN or infinity."""
    GEOFENCE = "geofence", Kind.STOPS
    """The robot would come to rest outside its fence."""
    BATTERY = "battery", Kind.STOPS
    BATTERY_LOST = "battery_lost", Kind.STOPS
    """The robot no longer reports its battery charge."""
    POSITION_LOST = "position_lost", Kind.STOPS
    """The robot no longer reports its position."""
    POSITION_JUMPED = "position_jumped", Kind.STOPS
    """The position changed by more than motion explains: its estimate was reset, or is wrong."""
    STATE_LOST = "state_lost", Kind.STOPS
    """No new state from the robot, or one older than the last."""
    NOT_ENGAGED = "not_engaged", Kind.STOPS
    """The robot reports that it no longer accepts commands."""
    ROBOT_STOPPED = "robot_stopped", Kind.STOPS
    """The robot, or its adapter, latched a stop."""
    TAKEOVER = "takeover", Kind.STOPS
    """Somebody else has control."""
    REFUSED = "refused", Kind.STOPS
    """The adapter could not send."""
    SUSPENDED = "suspended", Kind.STOPS
    """The machine was suspended."""
    ASKED = "asked", Kind.STOPS
    """Requested by the operator, or the end of the trial."""

    BATTERY_LOW = "battery_low", Kind.WARNS
    """Low battery: a warning; nothing is changed yet."""


def limited(names: Iterable[str]) -> bool:
    """Return whether a logged command was changed to keep it within limits."""
    return any(name in _LIMITS for name in names)


def withheld(names: Iterable[str]) -> bool:
    """Return whether a logged command was withheld or the robot stopped; an unknown name counts as such."""
    return any(name not in _LIMITS | _WARNS for name in names)


_LIMITS = frozenset(reason.value for reason in Reason if reason.kind is Kind.LIMITS)
_WARNS = frozenset(reason.value for reason in Reason if reason.kind is Kind.WARNS)
