"""The node's decision, at every turn: what the Go2 is asked for. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Twist

STOPS = 3
"""Number of StopMove requests; one can be lost."""

Wish = Literal["stop"]


@dataclass(slots=True)
class Walker:
    """Passes commands on; without one, or without its host, stops the robot once and leaves it to its remote.

    Silent at first: a node that is started moves and stops nothing.
    """

    timeout_s: float
    """The command time-out, s."""
    _heard_s: float = -math.inf
    _stops_left: int = 0

    @property
    def walks(self) -> bool:
        """The robot may still walk by a command that was passed on."""
        return self._stops_left > 0

    def step(self, now_s: float, command: Twist | None, *, host_left: bool) -> Twist | Wish | None:
        """Return what to ask for now, None for nothing.

        Args:
            now_s: monotonic.
            command: that came since the last step.
            host_left: the host's liveliness token went since the last step; its last command counts no more.
        """
        if host_left:
            self._heard_s = -math.inf
        elif command is not None:
            self._heard_s, self._stops_left = now_s, STOPS
            return command
        if self._stops_left and now_s - self._heard_s > self.timeout_s:
            self._stops_left -= 1
            return "stop"
        return None
