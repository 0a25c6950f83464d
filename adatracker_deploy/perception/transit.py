"""Estimates the delay that a network or a queue added to an image. Pure.

The offset between the sender's clock and ours is unknown, so arrival minus stamp is meaningless by itself.
Its growth over the smallest value seen is the delay: two clocks hardly drift apart. A delay present from the
first image on is not detected.
"""

from __future__ import annotations

DRIFT_PPM = 250
"""Allowed growth of the least travel time: two ordinary quartz clocks, of 100 ppm each, drift apart by 200
ppm at most. A queue that grows more slowly than this passes for drift: 0.09 s in six minutes."""


class Transit:
    """Watches one sender's pictures; times are of this machine's clock, stamps of the sender's."""

    def __init__(self) -> None:
        self._least_ns: int | None = None
        """Smallest arrival minus stamp, plus the drift allowed since."""
        self._arrived_ns = 0

    def delay_ns(self, stamp_ns: int, arrived_ns: int) -> int:
        """Return this image's delay relative to the fastest one, 0 or more.

        With stamps and arrivals that only grow, arrival less delay never goes backwards.

        Args:
            stamp_ns: the sender's, of when it took the picture.
            arrived_ns: when it was received, not before the last one.
        """
        offset_ns = arrived_ns - stamp_ns
        if self._least_ns is None:
            self._least_ns = offset_ns
        else:
            forgiven_ns = (arrived_ns - self._arrived_ns) * DRIFT_PPM // 1_000_000
            self._least_ns = min(self._least_ns + forgiven_ns, offset_ns)
        self._arrived_ns = arrived_ns
        return offset_ns - self._least_ns
