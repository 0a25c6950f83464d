"""The phases of a trial into which faults are struck, in their order. Pure."""

from __future__ import annotations

import enum


class TrialPhase(enum.StrEnum):
    """Where a trial is, as ``--fault NAME@PHASE`` names it."""

    CONNECTING = "connecting"
    """The link opens the wire and hears the robot."""
    ENGAGING = "engaging"
    """The robot was asked to obey: a base is enabled, a robot on legs stands ready, a drone is armed."""
    ARMED = "armed"
    """A drone's motors turn; it is on the ground. Part of engaging."""
    CLIMBING = "climbing"
    """A drone is on its way up. Part of engaging."""
    LOOKING = "looking"
    """Engaged and standing still until the person is seen."""
    FOLLOWING = "following"
    STOPPING = "stopping"
    """Zero is asked for until the robot stands."""
    DISENGAGING = "disengaging"
    """A base is disabled, a drone lands."""
    BETWEEN = "between"
    """The trial is over and written down; the next one of ``--trials`` has not begun."""


IN_FLIGHT = frozenset({TrialPhase.ARMED, TrialPhase.CLIMBING})
"""Phases of robots that fly."""
ORDER = tuple(TrialPhase)
"""A trial enters its phases in this order, and may leave any of them for STOPPING."""
ENDING = ORDER[ORDER.index(TrialPhase.STOPPING) :]
"""What is still ahead when a trial ends."""
