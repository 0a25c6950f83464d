"""What cameras that cannot wait have in common: a reader thread, of whose pictures only the newest is kept.

A camera that hangs looks exactly like a scene in which nothing moves, so silence, a picture that repeats and
a size that changes end the camera. Nothing here reconnects: a robot never moves again by itself.
"""

from __future__ import annotations

import abc
import contextlib
import threading
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from adatracker_deploy.errors import PlatformError
from adatracker_deploy.messages import Frame, Truth
from adatracker_deploy.perception.camera import OPEN_TIMEOUT_S

if TYPE_CHECKING:
    from collections.abc import Generator

    from numpy.typing import NDArray

    from adatracker_deploy.runtime.clock import Clock

STALE_AFTER_S = 2.0
"""Machine time without a new picture after which a camera counts as gone, s."""
FROZEN_AFTER_S = 2.0
"""Machine time of one and the same picture after which it does; a real sensor's noise never repeats, s."""
_JOIN_TIMEOUT_S = 2.0
"""A driver that hangs cannot be interrupted; its thread is left behind."""


class Picture(NamedTuple):
    """What a reader thread hands over."""

    rgb: NDArray[np.uint8]
    """Shape (H, W, 3)."""
    t_ns: int
    """The run's clock when it arrived, before it was decoded."""
    truth: Truth | None = None


class LiveCamera(abc.ABC):
    """A `Camera` with a reader thread; a subclass says where the pictures come from.

    Args:
        name: how errors name it: its URI, without any password.
        clock: the run's.
    """

    def __init__(self, name: str, clock: Clock) -> None:
        self.name = name
        self.clock = clock
        self._newest: Frame | None = None
        self._before: Frame | None = None
        """The frame before the newest, for a reader whose `now_ns` the newest has just overtaken."""
        self._changed_ns = 0
        """When the picture last differed from the one before."""
        self._error: Exception | None = None
        self._decided = threading.Event()
        """Set by the first frame, or by what keeps it from coming."""
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"camera {name}", daemon=True)

    @abc.abstractmethod
    def _pictures(self) -> Generator[Picture, None, None]:
        """Reach the camera and give its pictures as they come; runs in the reader's thread.

        Raises:
            PlatformError: it cannot be reached, or it is gone.
        """

    @abc.abstractmethod
    def _interrupt(self) -> None:
        """Make a `_pictures` that waits for the wire end soon, where that can be done; from any thread."""

    def open(self) -> None:
        """Start the reader and wait for its first frame.

        Raises:
            PlatformError: the camera cannot be reached, or gave no picture within `OPEN_TIMEOUT_S`.
        """
        self._thread.start()
        if not self._decided.wait(OPEN_TIMEOUT_S):
            self._error = PlatformError(f"camera {self.name}: no picture came within {OPEN_TIMEOUT_S:g} s")
        if self._newest is None and self._error is not None:
            self.close()
            raise self._error

    def read(self, now_ns: int) -> Frame | None:
        """Return the newest frame that had arrived at `now_ns`.

        Raises:
            PlatformError: the camera is gone, silent or frozen.
        """
        if self._error is not None:
            raise self._error
        before, newest = self._before, self._newest
        if newest is None:
            return None
        self._refuse_dead(newest, now_ns)
        return newest if newest.t_ns <= now_ns else before

    def go(self) -> None:  # noqa: B027 -- what most cameras do
        """Do nothing: real people walk when they like."""

    def close(self) -> None:
        """End the reader and let go of the camera."""
        self._ending.set()
        self._interrupt()
        if self._thread.is_alive():
            self._thread.join(_JOIN_TIMEOUT_S)

    def _refuse_dead(self, newest: Frame, now_ns: int) -> None:
        silent_s = (now_ns - newest.t_ns) / 1e9 / self.clock.speed
        if silent_s > STALE_AFTER_S:
            raise PlatformError(f"camera {self.name}: no picture has come for {silent_s:.1f} s")
        same_s = (newest.t_ns - self._changed_ns) / 1e9 / self.clock.speed
        if same_s > FROZEN_AFTER_S and newest.truth is None:  # before people go, a rehearsal stands still
            raise PlatformError(
                f"camera {self.name}: has given the very same picture for {same_s:.1f} s: it hangs or is covered"
            )

    def _run(self) -> None:
        try:
            with contextlib.closing(self._pictures()) as pictures:
                for picture in pictures:
                    if self._ending.is_set():
                        return
                    self._keep(picture)
            raise PlatformError(f"camera {self.name}: the stream has ended")
        except Exception as error:  # handed to whoever reads next
            self._error = error
        finally:
            self._decided.set()

    def _keep(self, picture: Picture) -> None:
        last = self._newest
        if last is not None and last.rgb.shape != picture.rgb.shape:
            was, now = (f"{rgb.shape[1]}x{rgb.shape[0]}" for rgb in (last.rgb, picture.rgb))
            raise PlatformError(f"camera {self.name}: the picture's size changed from {was} to {now} px")
        if last is None or not np.array_equal(last.rgb, picture.rgb):
            self._changed_ns = picture.t_ns
        self._before = last
        self._newest = Frame(picture.rgb, picture.t_ns, last.seq + 1 if last else 1, picture.truth)
        self._decided.set()
