"""The name of everything for which a command is changed, a robot stopped or an operator warned."""

from __future__ import annotations

import enum


class Reason(enum.StrEnum):
    """Why what was sent is not what was asked for; the names stand in status, logs and profiles."""

    ENVELOPE = "envelope"
    """Faster than the limits."""
    RAMP = "ramp"
    """Faster than so soon after engaging."""
    TOO_CLOSE = "too_close"
    """Forward, with the target's box too large."""
    ALTITUDE = "altitude"
    """Towards the edge of the altitude band; or, as a stop, well outside it."""
    ACCELERATION = "acceleration"
    JERK = "jerk"
    STALE = "stale"
    """The command is too old: zero, until a fresh one comes."""
    BLIND = "blind"
    """What the command was made from was seen too long ago: zero, until a newer frame comes."""

    COMMAND_LOST = "command_lost"
    """No fresh command for so long that a stop latched."""
    NOT_FINITE = "not_finite"
    """NaN or infinity was asked for."""
    GEOFENCE = "geofence"
    """The robot would come to rest outside its fence."""
    BATTERY = "battery"
    STATE_LOST = "state_lost"
    """Nothing measured was heard of the robot."""
    NOT_ENGAGED = "not_engaged"
    """The robot says that it no longer obeys."""
    ROBOT_STOPPED = "robot_stopped"
    """The robot, or its adapter, latched a stop."""
    TAKEOVER = "takeover"
    """Somebody else has control."""
    REFUSED = "refused"
    """The adapter could not send."""
    SUSPENDED = "suspended"
    """The machine slept."""
    ASKED = "asked"
    """The operator, or the end of the trial."""

    BATTERY_LOW = "battery_low"
    """A warning: nothing is changed yet."""
