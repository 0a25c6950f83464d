"""Runs perception in its own thread; the loop takes the newest observation, or waits a little for one."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING, Self

from adatracker_deploy.core.errors import PlatformError, line_of
from adatracker_deploy.core.messages import Seen
from adatracker_deploy.core.sight import judged
from adatracker_deploy.perception.segmenter import check_observation
from adatracker_deploy.runtime.pacer import Pacer

if TYPE_CHECKING:
    from types import TracebackType

    from adatracker_deploy.core.camera import Camera
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.messages import Click, Frame
    from adatracker_deploy.perception.segmenter import Segmenter


CLOSE_TIMEOUT_S = 5.0
"""A segmenter that does not return in time is abandoned; its thread ends with the process."""

_left_behind: list[tuple[Segmenter, threading.Thread]] = []
"""Segmenters that hung when perception was closed, with their threads."""


def perceive(frame: Frame, segmenter: Segmenter) -> Seen:
    """Segment one frame, as `Perception` does in its thread, and tests and scoring do frame by frame.

    Raises:
        PlatformError: the segmenter fails, or its result is not an observation of this frame.
    """
    observation = segmenter(frame)
    check_observation(observation, frame)
    sight = None if frame.truth is None else judged(observation.mask, frame.truth)
    return Seen(frame, observation, sight=sight)


def refuse_hung(segmenter: Segmenter) -> None:
    """Check that no thread is still in the segmenter: two trials at once would share its state.

    Raises:
        PlatformError: it hung in an earlier trial, and still does.
    """
    if any(hung is segmenter and thread.is_alive() for hung, thread in _left_behind):
        raise PlatformError(
            "the segmenter still hangs in a frame of an earlier trial, so no other can start: "
            "end this program, and find out why it hangs"
        )


class Perception:
    """Polls for a new frame at a steady rate and segments it, in its own thread."""

    def __init__(self, camera: Camera, segmenter: Segmenter, clock: Clock, rate_hz: float) -> None:
        self._camera = camera
        self._segmenter = segmenter
        self._clock = clock
        self._rate_hz = rate_hz
        self._newest: Seen | None = None
        self._error: PlatformError | None = None
        self._clicks: deque[Click] = deque(maxlen=1)  # the last wish is the one that counts
        self._looking = False
        self._looked = threading.Condition()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="perception", daemon=True)
        self._thread.start()

    def newest(self, patience_s: float = 0.0) -> Seen | None:
        """Return the newest observation, or None before the first.

        Args:
            patience_s: machine time; how long to wait for the next one, if its picture is being looked at and
                the last one is more than half as old as the time between the pictures of the last two.

        Raises:
            PlatformError: the error that ended the camera or the segmenter.
        """
        if patience_s > 0 and self._due():
            with self._looked:
                self._looked.wait_for(lambda: not self._looking, patience_s)
        if self._error is not None:
            raise self._error
        return self._newest

    def choose(self, click: Click) -> None:
        """Ask the segmenter, with the next frame, to follow whom the operator has clicked on."""
        self._clicks.append(click)

    def close(self) -> None:
        """End the thread, or abandon it if it hangs in the segmenter; may be called twice."""
        self._ending.set()
        self._thread.join(CLOSE_TIMEOUT_S)
        if self._thread.is_alive():
            _left_behind.append((self._segmenter, self._thread))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _due(self) -> bool:
        last = self._newest
        if last is None or last.ready_ns is None or last.spacing_ns is None:
            return False
        return self._clock.now_ns() - last.ready_ns > last.spacing_ns / 2

    def _look(self, looking: bool) -> None:
        with self._looked:
            self._looking = looking
            self._looked.notify_all()

    def _run(self) -> None:
        pacer = Pacer(self._clock, self._rate_hz)
        try:
            while not self._ending.is_set():
                frame = self._camera.read(pacer.wait().t_ns)
                if frame is not None and (self._newest is None or frame.seq != self._newest.frame.seq):
                    taken_ns = self._clock.now_ns()
                    if self._clicks:
                        frame = replace(frame, click=self._clicks.popleft())
                    self._look(True)
                    seen = perceive(frame, self._segmenter)
                    spacing_ns = None if self._newest is None else frame.t_ns - self._newest.frame.t_ns
                    self._newest = seen._replace(
                        taken_ns=taken_ns, ready_ns=self._clock.now_ns(), spacing_ns=spacing_ns
                    )
                    self._look(False)
        except PlatformError as error:  # raised at the next call
            self._error = error
        except BaseException as error:  # a fault of ours or a model's, sys.exit too: the robot stops
            self._error = PlatformError(f"perception: {type(error).__name__}: {line_of(error)}")
            self._error.__cause__ = error
        finally:
            self._look(False)
