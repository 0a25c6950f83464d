"""The loop's view of the operator's hand: who drives at this tick, and what it asks for.

Devices put events in from their own threads; a recording has them all. Either way a tick takes exactly the
events up to its own time, so that the same events and ticks give the same commands to the bit.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from adatracker_deploy.runtime.teleop.takeover import Code, HandState, InputEvent, Wish, after, begun, wish

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from adatracker_deploy.core.clock import Clock


class Hand:
    """One trial's hand.

    Args:
        clock: the run's.
        stop: asks to end the trial; called by whoever brings the event, and at most once.
        alone: there is no policy to give back to.
        recorded: events of a file, ordered; they come in their own time after the first tick.
    """

    def __init__(
        self,
        clock: Clock,
        stop: Callable[[], None],
        *,
        alone: bool = False,
        recorded: Iterable[InputEvent] = (),
    ) -> None:
        self._clock = clock
        self._stop = stop
        self._lock = threading.Lock()
        self._state = HandState(alone=alone)
        self._came: list[tuple[int, Code, float]] = []
        """Events of a device that no tick has taken yet, with the run's clock."""
        self._recorded = list(reversed(tuple(recorded)))
        self._begin_ns: int | None = None
        self._newest_ns = 0
        """The newest tick."""
        self._taken: list[InputEvent] = []
        self._stopped = False

    @property
    def gone(self) -> bool:
        """Whether the device was lost."""
        with self._lock:
            return self._state.gone or any(code == "gone" for _, code, _ in self._came)

    @property
    def events(self) -> tuple[InputEvent, ...]:
        """The events that ticks have taken, in order."""
        return tuple(self._taken)

    def put(self, *events: tuple[Code, float]) -> None:
        """Take what a device tells now; events of one call stay together."""
        with self._lock:  # under which the time is read: a tick has got every event up to its own time
            now_ns = max(self._clock.now_ns(), self._newest_ns + 1)
            self._came += [(now_ns, code, value) for code, value in events]
        if any(code == "stop" for code, _ in events):
            self._end()

    def at(self, t_ns: int) -> Wish:
        """Return what the hand asks for at a tick; times are of the run's clock, and never run backwards.

        Of what came before the first tick only the axes and a lost device count: a button that was already
        down must be pressed anew.
        """
        with self._lock:
            begins = self._begin_ns is None
            begin_ns = t_ns if self._begin_ns is None else self._begin_ns
            self._begin_ns, self._newest_ns = begin_ns, t_ns
            due = self._due(t_ns, begin_ns)
            for event in due:
                self._state = after(self._state, event)
            self._state = begun(self._state) if begins else self._state
            asked = wish(self._state, t_ns - begin_ns)
            self._taken += due
        if any(event.code == "stop" for event in due):
            self._end()
        if asked.held_until_ns is None:
            return asked
        return Wish(asked.drives, asked.values, asked.held_until_ns + begin_ns)

    def _due(self, t_ns: int, begin_ns: int) -> list[InputEvent]:
        """Return the events up to `t_ns`, which no longer wait for a tick."""
        due = [
            InputEvent(at_ns - begin_ns, code, value) for at_ns, code, value in self._came if at_ns <= t_ns
        ]
        self._came = [event for event in self._came if event[0] > t_ns]
        while self._recorded and self._recorded[-1].t_ns <= t_ns - begin_ns:
            due.append(self._recorded.pop())
        return due

    def _end(self) -> None:
        if not self._stopped:
            self._stopped = True
            self._stop()
