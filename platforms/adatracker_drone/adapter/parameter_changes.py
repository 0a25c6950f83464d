"""Changes that would make an autopilot's parameters pass the preflight. Pure; nothing is written here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from adatracker_drone.adapter.preflight import (
    LONGEST_LOSS_S,
    LOSS_ACTIONS,
    OVERRIDE_IN_OFFBOARD,
    SAFE_LOSS_ACTIONS,
    STOPPING_FENCE_ACTIONS,
)

if TYPE_CHECKING:
    from adatracker_drone.adapter.preflight import Parameters

_LAND, _FENCE_HOLD = 4, 2


@dataclass(frozen=True, slots=True)
class Change:
    """One parameter to write."""

    name: str
    now: float
    value: float
    kind: type[int] | type[float]
    why: str

    def __str__(self) -> str:
        return f"{self.name:<16} {self.now:g} -> {self.value:g}   {self.why}"


def proposed(parameters: Parameters) -> tuple[Change, ...]:
    """Return the changes that the preflight asks for, of parameters that this autopilot has.

    The size of a fence is left to the operator, who knows the field.
    """
    changes = []
    loss_s, action = parameters.COM_OF_LOSS_T, parameters.COM_OBL_RC_ACT
    if loss_s is not None and not 0 < loss_s <= LONGEST_LOSS_S:
        changes.append(
            Change("COM_OF_LOSS_T", loss_s, LONGEST_LOSS_S, float, "s without set-points until they are lost")
        )
    if action is not None and action not in SAFE_LOSS_ACTIONS:
        was = LOSS_ACTIONS.get(int(action), "unknown")
        changes.append(
            Change("COM_OBL_RC_ACT", action, _LAND, int, f"land when they are lost, instead of: {was}")
        )
    sticks = parameters.COM_RC_OVERRIDE
    if sticks is not None and not int(sticks) & OVERRIDE_IN_OFFBOARD:
        changes.append(
            Change(
                "COM_RC_OVERRIDE",
                sticks,
                int(sticks) | OVERRIDE_IN_OFFBOARD,
                int,
                "the pilot's sticks end offboard at once",
            )
        )
    fence = parameters.GF_ACTION
    if fence is not None and int(fence) not in STOPPING_FENCE_ACTIONS:
        changes.append(Change("GF_ACTION", fence, _FENCE_HOLD, int, "hold at the fence"))
    return tuple(changes)
