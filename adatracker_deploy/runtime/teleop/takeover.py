"""The takeover as a pure state machine: events with their times make a state, a state makes a command.

The hand takes over when the dead-man button is pressed, and keeps driving until the operator gives back. A
released button, a lost device and a key that is not repeated are the same: zero, and the hand still drives.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, get_args

from adatracker_deploy.policy.base import ActionAxis, ActionSpec, Axis

Code = Literal[
    "dead_man", "dead_man_s", "take", "give_back", "stop", "gone", "forward", "lateral", "vertical", "yaw"
]
"""Kinds of events.

dead_man: the button is pressed (1) or released (0). dead_man_s: it counts as held for so many seconds more,
of a device that does not tell a release. take: take over and stand still. give_back: let the policy drive.
stop: end the trial. gone: the device is lost. The rest are axes, shares of the limits in [-1, 1], positive
forward, left, up and counter-clockwise.
"""
CODES: tuple[Code, ...] = get_args(Code)
AXES: tuple[Axis, ...] = get_args(Axis)
HAND_ACTION: ActionSpec = tuple(ActionAxis(axis=axis) for axis in AXES)
"""The order of a hand's values."""


@dataclass(frozen=True, slots=True)
class InputEvent:
    """Something that the operator did."""

    t_ns: int
    """When it was read, ns since the first tick; negative before it."""
    code: Code
    value: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class HandState:
    """The state that follows from the events so far."""

    alone: bool = False
    """There is no policy to give back to."""
    drives: bool = False
    """The hand drives, moving or standing."""
    pressed: bool = False
    """The dead-man button is down."""
    until_ns: int | None = None
    """Until when a key counts as held; None before the first."""
    gone: bool = False
    """The device is lost."""
    values: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """The axes, in the order of `AXES`."""

    def held(self, t_ns: int) -> bool:
        """Return whether the dead-man button counts as held."""
        return self.pressed or (self.until_ns is not None and t_ns < self.until_ns)


@dataclass(frozen=True, slots=True)
class Wish:
    """The command by hand at one tick."""

    drives: bool
    """The hand drives; without that the rest says nothing."""
    values: tuple[float, ...] = ()
    """In the order of `HAND_ACTION`; empty while the dead-man button is not held: zero."""
    held_until_ns: int | None = None
    """When the dead-man button no longer counts as held, on the clock of the tick; None for a button that
    tells its release."""


def after(state: HandState, event: InputEvent) -> HandState:
    """Return the state after an event; one whose device is gone does not change any more."""
    changed = state
    match event.code:
        case _ if state.gone:
            pass
        case "gone":  # who cannot take over any more does not leave the robot to the policy
            changed = replace(_released(state), gone=True, drives=True)
        case "dead_man" if event.value > 0:
            changed = replace(state, pressed=True, drives=True)
        case "dead_man":
            changed = _released(state)
        case "dead_man_s":
            changed = replace(state, until_ns=event.t_ns + round(event.value * 1e9), drives=True)
        case "take":
            changed = replace(_released(state), drives=True)
        case "give_back":
            changed = replace(state, drives=state.alone or (state.drives and state.held(event.t_ns)))
        case "stop":  # whoever brings it ends the trial
            pass
        case axis:
            forward, lateral, vertical, yaw = (
                event.value if name == axis else old for name, old in zip(AXES, state.values, strict=True)
            )
            changed = replace(state, values=(forward, lateral, vertical, yaw))
    return changed


def begun(state: HandState) -> HandState:
    """Return the state at the first tick: a button that was already down must be pressed anew."""
    return replace(_released(state), drives=state.alone or state.gone)


def wish(state: HandState, t_ns: int) -> Wish:
    """Return what the hand asks for at `t_ns`."""
    if not state.drives:
        return Wish(False)
    if not state.held(t_ns):
        return Wish(True, held_until_ns=t_ns)
    return Wish(True, state.values, None if state.pressed else state.until_ns)


def _released(state: HandState) -> HandState:
    return replace(state, pressed=False, until_ns=None)
