"""What cameras that cannot wait have in common: a reader thread, of whose pictures only the newest is kept.

Nothing here reconnects: a camera that was gone is opened anew by whoever says that the robot may move again.
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
from adatracker_deploy.perception.transit import Transit
from adatracker_deploy.perception.watch import FrameWatch

if TYPE_CHECKING:
    from collections.abc import Generator

    import numpy as np
    from numpy.typing import NDArray

    from adatracker_deploy.core.clock import Clock

NO_STAMPS = "sends no time stamps: pictures that the network holds back look new"
"""What is said of a camera that hides delay."""
_JOIN_TIMEOUT_S = 2.0
"""A driver that hangs cannot be interrupted; its thread is left behind."""


class Picture(NamedTuple):
    """What a reader thread hands over."""

    rgb: NDArray[np.uint8]
    """Shape (H, W, 3)."""
    t_ns: int
    """The run's clock when it arrived, before it was decoded."""
    stamp_ns: int = 0
    """When the sender took it, ns of its machine's time, whatever it counts from; 0 if it does not say."""
    truth: Truth | None = None
    jpeg: bytes | None = None
    """What `rgb` was decoded from, if it was one."""


class LiveCamera(abc.ABC):
    """A `Camera` with a reader thread; a subclass says where the pictures come from.

    A frame's time is that of its arrival, less what its sender's stamp says it was delayed on its way; a
    picture that is no newer than the one before is none. So whatever limits a frame's age limits the delay.

    Args:
        name: how errors name it: its URI, without any password.
        clock: the run's.
    """

    def __init__(self, name: str, clock: Clock) -> None:
        self.name = name
        self.clock = clock
        self.dropped = 0
        """Pictures that were malformed, repeated or older than one before."""
        self._order = StampOrder()
        self._transit = Transit()
        self._watch = FrameWatch(name, clock.speed)
        self._frames: tuple[Frame, ...] = ()
        """The newest and the one before it, for a reader whose `now_ns` the newest has just overtaken."""
        self._unstamped = False
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
        """Make a `_pictures` that waits for its device end soon, where that can be done; from any thread."""

    @property
    def hides_delay(self) -> bool:
        """The pictures come over a network without stamps: what it holds back looks new."""
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
        """Return the newest frame that had arrived at `now_ns`.

        Raises:
            PlatformError: the camera is gone, silent, frozen or late.
        """
        if self._error is not None:
            raise self._error
        self._watch.refuse_dead(now_ns)
        return next((frame for frame in self._frames if frame.t_ns <= now_ns), None)

    def go(self) -> None:  # noqa: B027 -- what most cameras do
        """Do nothing: real people walk when they like."""

    def close(self) -> None:
        """End the reader and let go of the camera."""
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
        except Exception as error:  # handed to whoever reads next
            self._error = error
        finally:
            self._decided.set()

    def _silent(self) -> PlatformError:
        """Return what is said of a camera that never showed a picture, whoever finds it out first."""
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
        """Return when a picture was taken, at the latest, by the run's clock."""
        if not picture.stamp_ns:
            return picture.t_ns
        speed = self.clock.speed
        delay_ns = self._transit.delay_ns(picture.stamp_ns, round(picture.t_ns / speed))
        return picture.t_ns - round(delay_ns * speed)
