"""What a place with a real SocketCAN bus is: something that runs a command beside a ``vcan0``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence

ROOT = Path(__file__).parents[3]
"""Of the repository, where commands are run."""
TIMED_OUT = 124
"""Exit status of a command that ran into its limit, as timeout(1) has it."""


@dataclass(frozen=True, slots=True)
class Ended:
    """How a command ended."""

    status: int
    """As a shell tells it: 128 and the signal's number if one killed it, 124 at the time limit."""
    output: str
    """Its standard output and error, as they came."""


class Room(Protocol):
    """Runs a command beside a ``vcan0``."""

    def __call__(self, command: Sequence[str], *, limit_s: float) -> Ended:
        """Return how it ended; nothing of it is left by then."""
