"""Base class of live cameras: a reader thread of which only the newest image is kept.

Nothing here reconnects: a lost camera is opened again by the next run.
"""

from __future__ import annotations

import abc
import contextlib
import threading
from typing import TYPE_CHECKING, NamedTuple

from adatracker_deploy.core.camera import OPEN_TIMEOUT_S
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import Frame, Truth
from adatracker_deploy.core.stamps import StampOrder
from adatracker_deploy.perception.frame_monitor import FrameMonitor
from adatracker_deploy.perception.transit import Transit

if TYPE_CHECKING:
    from collections.abc import Generator

    import numpy as np
    from numpy.typing import NDArray

    from adatracker_deploy.core.camera_info import CameraInfo
    from adatracker_deploy.core.clock import Clock

NO_STAMPS = "sends no time stamps: pictures that the network holds back look new"
"""Warning about a camera that hides delay."""
_JOIN_TIMEOUT_S = 2.0
"""Time to wait for the reader thread; a driver that hangs cannot be interrupted, and its thread is
abandoned."""


class Picture(NamedTuple):
    """An image from a reader thread."""

    rgb: NDArray[np.uint8]
    """Shape (H, W, 3)."""
    t_ns: int
    """The run's clock when it arrived, before it was decoded."""
    stamp_ns: int = 0
    """The sender's capture time, ns, with any epoch; 0 if it gives none."""
    truth: Truth | None = None
    jpeg: bytes | None = None
    """The JPEG that `rgb` was decoded from, if any."""


class LiveCamera(abc.ABC):
    """A `Camera` with a reader thread; subclasses provide the images.

    A frame's time is its arrival less the delay derived from the sender's stamps. An image no newer than the
    one before is dropped. So a limit on a frame's age also limits the delay.

    Args:
        name: how errors name it: its URI, without any password.
        clock: the run's.
    """

    def __init__(self, name: str, clock: Clock) -> None:
        self.name = name
        self.clock = clock
        self.lens: CameraInfo | None = None
        """The camera's lens, where it tells it beside its images."""
        self.dropped = 0
        """Number of images that were malformed, repeated or out of order."""
        self._order = StampOrder()
        self._transit = Transit()
        self._watch = FrameMonitor(name, clock.speed)
        self._frames: tuple[Frame, ...] = ()
        """The newest frame and the one before, for a reader whose `now_ns` is just before the newest."""
        self._unstamped = False
        self._error: Exception | None = None
        self._decided = threading.Event()
        """Set by the first frame, or by an error that prevents it."""
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"camera {name}", daemon=True)

    @abc.abstractmethod
    def _pictures(self) -> Generator[Picture, None, None]:
        """Connect to the camera and yield its images as they arrive; runs in the reader thread.

        Raises:
            PlatformError: it cannot be reached, or was lost.
        """

    @abc.abstractmethod
    def _interrupt(self) -> None:
        """Make a waiting `_pictures` end soon, where possible; from any thread."""

    @property
    def hides_delay(self) -> bool:
        """Whether images come over a network without stamps, so that delayed ones look new."""
        return self._unstamped

    def open(self) -> None:
        """Start the reader and wait for its first frame.

        Raises:
            PlatformError: the camera cannot be reached, or gave no picture within `OPEN_TIMEOUT_S`.
        """
        self._thread.start()
        error = self._error if self._decided.wait(OPEN_TIMEOUT_S) else self._silent()
        if error is not None:
            self.close()
            raise error

    def read(self, now_ns: int) -> Frame | None:
        """Return the newest frame that had arrived by `now_ns`.

        Raises:
            PlatformError: the camera is lost, silent, frozen or late.
        """
        if self._error is not None:
            raise self._error
        self._watch.refuse_dead(now_ns)
        return next((frame for frame in self._frames if frame.t_ns <= now_ns), None)

    def go(self) -> None:  # noqa: B027 -- what most cameras do
        """Do nothing: only simulated people wait for it."""

    def close(self) -> None:
        """Stop the reader and release the camera."""
        self._ending.set()
        self._interrupt()
        if self._thread.is_alive():
            self._thread.join(_JOIN_TIMEOUT_S)

    def _run(self) -> None:
        try:
            with contextlib.closing(self._pictures()) as pictures:
                for picture in pictures:
                    if self._ending.is_set():
                        return
                    self._keep(picture)
            raise PlatformError(f"camera {self.name}: the stream has ended")
        except Exception as error:  # raised by the next read
            self._error = error
        finally:
            self._decided.set()

    def _silent(self) -> PlatformError:
        """Return the error for a camera that never sent an image."""
        return PlatformError(f"camera {self.name}: no picture came within {OPEN_TIMEOUT_S:g} s")

    def _keep(self, picture: Picture) -> None:
        if not self._order.is_new(picture.stamp_ns):
            self.dropped += 1
            if self._order.restarts:
                raise PlatformError(
                    f"camera {self.name}: its time stamps went back: it was restarted, or its clock was set"
                )
            return
        self._unstamped = picture.stamp_ns == 0
        seq = self._frames[0].seq + 1 if self._frames else 1
        frame = Frame(picture.rgb, self._taken_ns(picture), seq, picture.truth, picture.jpeg)
        if self._watch.accept(frame, picture.t_ns):
            self._frames = (frame, *self._frames[:1])
        self._decided.set()

    def _taken_ns(self, picture: Picture) -> int:
        """Return the latest possible capture time of an image, by the run's clock."""
        if not picture.stamp_ns:
            return picture.t_ns
        speed = self.clock.speed
        delay_ns = self._transit.delay_ns(picture.stamp_ns, round(picture.t_ns / speed))
        return picture.t_ns - round(delay_ns * speed)
