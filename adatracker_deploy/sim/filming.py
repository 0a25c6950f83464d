"""Takes pictures of a virtual world at a steady rate, drawn by a process of their own.

On a busy machine drawing would otherwise hold up whatever shares its process: a robot's protocol, the loop.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import threading
from typing import TYPE_CHECKING, Protocol

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.runtime.pacer import Pacer
from adatracker_deploy.sim.studio import Studio, View

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.connection import Connection

    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.messages import Shot
    from adatracker_deploy.platform import Scenario

LOOK_S = 0.05
"""Interval at which a thread waiting for a picture checks whether the film has ended."""


class Drawing(Protocol):
    """Draws pictures elsewhere; `DrawingProcess` is the one."""

    def take(self, view: View, ended: threading.Event) -> Shot | None:
        """Return a picture; None if `ended` was set meanwhile."""

    def close(self) -> None:
        """End it."""


class DrawingProcess:
    """A studio in a process of its own; takes a studio's arguments."""

    def __init__(
        self,
        scenario: Scenario,
        fov_rad: float,
        *,
        own_frame: bool = False,
    ) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, there = context.Pipe()
        self._process = context.Process(
            target=_draw, args=(there, scenario, fov_rad, own_frame), name="drawing", daemon=True
        )
        self._process.start()
        there.close()

    def take(self, view: View, ended: threading.Event) -> Shot | None:
        """Return a picture; None if `ended` was set meanwhile.

        Raises:
            UsageError, PlatformError: the world cannot be drawn.
            EOFError, ConnectionError: the process has ended.
        """
        self._pipe.send(view)
        while not self._pipe.poll(LOOK_S):
            if ended.is_set():
                return None
        answer: Shot | UsageError | PlatformError = self._pipe.recv()
        if isinstance(answer, UsageError | PlatformError):
            raise answer
        return answer

    def close(self) -> None:
        """End the process."""
        self._pipe.close()
        self._process.terminate()
        self._process.join()


def film(
    drawing: Drawing,
    view: Callable[[int], View | None],
    clock: Clock,
    rate_hz: float,
    publish: Callable[[Shot], None],
    *,
    ended: threading.Event,
) -> None:
    """Have pictures taken at `rate_hz` and pass them to `publish` until `ended` is set.

    Args:
        drawing: draws them; closed at the end.
        view: returns what to draw at a time of `clock`, or None for nothing yet.
        clock: the run's.
        rate_hz: pictures a second of the run's.
        publish: receives each picture.
        ended: ends the film.

    Raises:
        UsageError, PlatformError: the world cannot be drawn.
        EOFError, ConnectionError: what draws has ended.
    """
    pacer = Pacer(clock, rate_hz)
    with contextlib.closing(drawing):
        while not ended.is_set():
            seen_from = view(pacer.wait().t_ns)
            shot = None if seen_from is None else drawing.take(seen_from, ended)
            if shot is not None:
                publish(shot)


def _draw(pipe: Connection, scenario: Scenario, fov_rad: float, own_frame: bool) -> None:
    """Answer each view with its picture until the other end closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the client notices, and closes the pipe
    with contextlib.suppress(EOFError, ConnectionError):
        try:
            studio = Studio(scenario, fov_rad, own_frame=own_frame)
            while True:
                pipe.send(studio.take(pipe.recv()))
        except (UsageError, PlatformError) as error:
            pipe.send(error)
