"""The interface of a place with a real SocketCAN bus: it runs a command beside a ``vcan0``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence

ROOT = Path(__file__).parents[3]
"""The repository's root, where commands are run."""
TIMED_OUT = 124
"""Exit status of a command that ran into its limit, as timeout(1) has it."""


@dataclass(frozen=True, slots=True)
class Ended:
    """The result of a command that has ended."""

    status: int
    """As a shell reports it: 128 plus the signal's number if one killed it, 124 at the time limit."""
    output: str
    """Its standard output and error, as they came."""


class Room(Protocol):
    """Runs a command beside a ``vcan0``."""

    def __call__(self, command: Sequence[str], *, limit_s: float) -> Ended:
        """Run a command and return its result; none of its processes is left by then."""
