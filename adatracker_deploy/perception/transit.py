"""How much longer than usual a picture was on its way: what a network or a queue has added. Pure.

The sender's clock and ours differ by what nobody knows, so arrival minus stamp says nothing by itself. Its
growth over the least that was seen does: two clocks hardly drift apart, and no picture outruns its way. A
delay that is there from the first picture on is not seen.
"""

from __future__ import annotations

DRIFT_PPM = 250
"""The least seen is forgiven so much growth: two ordinary quartz clocks, of 100 ppm each, drift apart by 200
ppm at most. A queue that grows more slowly than this is not told from drift: 0.09 s in six minutes."""


class Transit:
    """Watches one sender's pictures; times are of this machine's clock, stamps of the sender's."""

    def __init__(self) -> None:
        self._least_ns: int | None = None
        """Of arrival minus stamp, with the drift that has been forgiven since."""
        self._arrived_ns = 0

    def delay_ns(self, stamp_ns: int, arrived_ns: int) -> int:
        """Return how much longer than the quickest this picture was on its way, 0 or more.

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
