"""The transmit thread: repeats the newest command at the base's period, and sends zero when it expires.

The base stops by itself when frames stop. A thread that goes on sending for a caller that hangs would take
that away (as the kernel's periodic send does: it outlives a stopped process). So every command expires: when
the next does not come in time, the thread sends zero three times and is silent until there is one.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import ZERO, Twist

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.core.clock import Clock

_SLACK = 0.25
"""Share of a period by which the next command may be late; a repeat just before it would delay it."""
ZEROS = 3
"""Number of zero commands at a stop; one frame can be lost."""


@dataclass(slots=True, kw_only=True)
class Stream:
    """The next command to send; pure. Silent at first."""

    lifetime_ns: int
    """A command is repeated for so long."""
    lapses: int = 0
    """Commands that ended because no newer one came."""
    twist: Twist | None = None
    offered_ns: int = 0
    zeros_left: int = 0

    def offer(self, twist: Twist, now_ns: int) -> None:
        """Replace the command."""
        self.twist, self.offered_ns, self.zeros_left = twist, now_ns, ZEROS

    def stop(self) -> None:
        """Zero three times, then silence."""
        self.twist, self.zeros_left = None, ZEROS

    def mute(self) -> None:
        """Silence, at once."""
        self.twist, self.zeros_left = None, 0

    @property
    def silent(self) -> bool:
        """Nothing goes out."""
        return self.twist is None and not self.zeros_left

    def next(self, now_ns: int) -> Twist | None:
        """Return what to send in this slot, None for nothing."""
        if self.twist is not None and now_ns - self.offered_ns > self.lifetime_ns:
            self.twist = None
            self.lapses += 1
        if self.twist is not None:
            return self.twist
        if self.zeros_left:
            self.zeros_left -= 1
            return ZERO
        return None


class Transmitter:
    """A thread that empties a `Stream` into the wire.

    A new command goes out at once, unless the last frame is less than half a period old: then after that.
    So a caller with the base's own period waits for nothing, and a faster one does not flood the bus.

    Args:
        transmit: puts one command on the wire; raises `PlatformError` when that cannot be done any more.
        clock: the run's.
        period_s: between frames, of the run's clock.
        lifetime_s: see `Stream`; of the run's clock.
    """

    def __init__(
        self, transmit: Callable[[Twist], None], clock: Clock, period_s: float, lifetime_s: float
    ) -> None:
        self.frames = 0
        """Commands put on the wire, repeats and zeros among them."""
        self.latency_s = 0.0
        """From the making of the newest command until it was on the wire, on the run's clock."""
        self._transmit = transmit
        self._clock = clock
        self._period_ns = round(period_s * 1e9)
        self._stream = Stream(lifetime_ns=round(lifetime_s * 1e9))
        self._changed = threading.Condition()
        self._last_ns = self._due_ns = 0
        self._told_ns = 0
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="can-transmit", daemon=True)
        self._thread.start()

    @property
    def lapses(self) -> int:
        """Number of times that commands ended without a stop."""
        return self._stream.lapses

    def send(self, twist: Twist, now_ns: int) -> None:
        """Let `twist`, made at `now_ns`, go out until another comes or its lifetime ends."""
        with self._changed:
            self._stream.offer(twist, now_ns)
            self._due_ns = min(self._due_ns, self._last_ns + self._period_ns // 2)
            self._changed.notify_all()

    def stop(self) -> None:
        """Say zero three times, the first at once, and be silent."""
        with self._changed:
            self._stream.stop()
            self._due_ns = 0
            self._changed.notify_all()

    def mute(self) -> None:
        """Be silent: when this returns nothing is on its way any more."""
        with self._changed:
            self._stream.mute()
            self._changed.notify_all()

    def wait_until_silent(self, timeout_s: float) -> bool:
        """Return whether everything has been said within `timeout_s` of machine time."""
        with self._changed:
            return self._changed.wait_for(lambda: self._stream.silent, timeout_s)

    def close(self) -> None:
        """End the thread without another word; may be called twice."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._thread.join()

    def _run(self) -> None:
        with self._changed:
            while not self._closed:
                now_ns = self._clock.now_ns()
                if not self._stream.silent and now_ns < self._due_ns:
                    self._changed.wait((self._due_ns - now_ns) / 1e9 / self._clock.speed)
                    continue
                twist = self._stream.next(now_ns)
                if twist is None:
                    self._changed.notify_all()
                    self._changed.wait()
                    continue
                self._put(twist)
                slack_ns = 0 if self._stream.twist is None else round(_SLACK * self._period_ns)
                self._last_ns, self._due_ns = now_ns, now_ns + self._period_ns + slack_ns

    def _put(self, twist: Twist) -> None:
        try:
            self._transmit(twist)
        except PlatformError:  # the wire's owner has noted why
            self._stream.mute()
            return
        self.frames += 1
        if self._stream.twist is not None and self._told_ns != self._stream.offered_ns:
            self._told_ns = self._stream.offered_ns
            self.latency_s = (self._clock.now_ns() - self._told_ns) / 1e9
