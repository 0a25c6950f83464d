"""Monitors MAVSDK's backlog: messages passed in but not yet delivered. Pure; time is an argument.

MAVSDK queues every message for its subscribers' thread, without limit. A flood or a busy machine would fill
the memory, and old telemetry would look new, because its age counts from delivery.
"""

from __future__ import annotations

MOST_BEHIND = 5
"""HEARTBEATs; an autopilot sends 1 to 5 a second."""
PATIENCE_S = 0.5
"""Without a delivery for this long nothing more is pending: MAVSDK has ignored some messages."""


class Backlog:
    """Counts HEARTBEATs, each delivered once. One thread passes them in, another receives them.

    Args:
        speed: the run's clock's seconds per second of the machine's: so much faster an autopilot talks.
    """

    def __init__(self, speed: float = 1.0) -> None:
        self._most = round(MOST_BEHIND * max(1.0, speed))
        self._handed: int | None = None
        """None while nobody subscribes."""
        self._told = 0
        self._told_s = 0.0

    def begin(self, now_s: float) -> None:
        """Count from now on: there is a subscriber."""
        self._told, self._told_s, self._handed = 0, now_s, 0

    def tell(self, now_s: float) -> None:
        """Count a HEARTBEAT that was delivered."""
        self._told += 1
        self._told_s = now_s

    def takes(self, heartbeats: int, now_s: float) -> bool:
        """Return whether MAVSDK may be handed more; where it may, it is counted as handed.

        Args:
            heartbeats: in what is to be handed over.
            now_s: monotonic.
        """
        if self._handed is None:
            return True
        if self._handed - self._told > self._most:
            if now_s - self._told_s < PATIENCE_S:
                return False
            self._handed = self._told
        self._handed += heartbeats
        return True
