"""Messages between a base and this toolkit, as values: frames, readings and demands.

No bytes are made or read here (`codec` does that, by a DBC and the profile's `roles`), and nothing is sent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from adatracker_deploy.core.messages import Twist

Mode = Literal["standby", "ours", "remote", "unknown"]
"""The controller of the base: nobody, this toolkit, somebody with a remote control, or an unknown value."""


class Malformed(ValueError):  # noqa: N818 - it reads as the adjective that it is
    """A frame with an id that a role names whose content cannot be believed: drop it and count it."""


@dataclass(frozen=True, slots=True)
class CanFrame:
    """One classic CAN data frame.

    Raises:
        ValueError: the id does not fit 11 bits (29 when extended), or there are more than 8 data bytes.
    """

    id: int
    data: bytes
    extended: bool = False
    """The id has 29 bits."""

    def __post_init__(self) -> None:
        if not 0 <= self.id < (1 << 29 if self.extended else 1 << 11):
            raise ValueError(f"CAN id {self.id:#x} does not fit {29 if self.extended else 11} bits")
        if len(self.data) > 8:
            raise ValueError(f"a CAN frame carries at most 8 bytes, not {len(self.data)}")


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseStatus:
    """A base's report of its own condition."""

    mode: Mode
    mode_name: str = ""
    """The base's own name for its mode, for display: at most 23 ASCII characters."""
    emergency_stop: bool = False
    fault: str = ""
    """The named faults, comma-separated; empty while the base works."""
    warning: str = ""
    """The named conditions that stop nothing, comma-separated."""
    volts: float | None = None
    """Supply voltage, V."""
    count: int | None = None
    """The base's own frame counter, where it has one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """The content of one received frame; None for what it does not carry."""

    status: BaseStatus | None = None
    motion: Twist | None = None
    """Measured velocity, body frame."""
    wheels_m: tuple[float, float] | None = None
    """Distance that the left and the right wheel have rolled since power-on, m; may wrap around."""
    battery: float | None = None
    """State of charge, 0 to 1."""
    volts: float | None = None
    """Battery voltage, V."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Demand:
    """The command of one frame, as the base reads it; one frame can ask for several things."""

    twist: Twist | None = None
    enable: bool = False
    disable: bool = False
    release_brake: bool = False
