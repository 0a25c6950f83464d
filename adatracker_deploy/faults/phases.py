"""The phases of a trial in which faults can be injected, in order. Pure."""

from __future__ import annotations

import enum


class TrialPhase(enum.StrEnum):
    """A phase of a trial, as in ``--fault NAME@PHASE``."""

    CONNECTING = "connecting"
    """The link opens the connection and receives the robot's first messages."""
    ENGAGING = "engaging"
    """The robot was asked to engage: a base is enabled, a legged robot stands ready, a drone is armed."""
    ARMED = "armed"
    """A drone is armed on the ground. Part of engaging."""
    CLIMBING = "climbing"
    """A drone climbs to its altitude. Part of engaging."""
    LOOKING = "looking"
    """Engaged and standing still until the person is seen."""
    FOLLOWING = "following"
    STOPPING = "stopping"
    """Zero is commanded until the robot stands."""
    DISENGAGING = "disengaging"
    """A base is disabled, a drone lands."""
    BETWEEN = "between"
    """The trial is over and logged; the next one of ``--trials`` has not begun."""


IN_FLIGHT = frozenset({TrialPhase.ARMED, TrialPhase.CLIMBING})
"""Phases of flying robots only."""
ORDER = tuple(TrialPhase)
"""A trial enters its phases in this order, and may leave any of them for STOPPING."""
ENDING = ORDER[ORDER.index(TrialPhase.STOPPING) :]
"""Phases still ahead when a trial ends."""
