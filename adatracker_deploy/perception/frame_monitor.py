"""Watchdog for cameras: detects silence, frozen images and late frames. Pure; time is passed in.

A frozen camera looks like a scene without motion, and a policy would steer by old images. So an exact copy of
the last image is not new, and as old as the first copy. Silence, a repeating image, a late image and a change
of size each end the camera.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.core.errors import PlatformError

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Frame

SILENT_AFTER_S = 2.0
"""Machine time without a frame, or delay of the newest one, after which a camera counts as lost, s."""
FROZEN_AFTER_S = 1.8
"""Machine time of identical images after which a camera counts as frozen: a real sensor's noise never
repeats, s.

The loop, to which no new frame has come since, gives up after 2 s and could not say why."""


class FrameMonitor:
    """Monitors the frames of one camera.

    Args:
        name: how errors name the camera.
        speed: seconds of the frames' clock per second of the machine's.
    """

    def __init__(self, name: str, speed: float = 1.0) -> None:
        self._name = name
        self._speed = speed
        self._last: Frame | None = None
        self._arrived_ns = 0
        """Arrival time of the newest frame."""
        self._unchanged_s = 0.0
        """Machine time for which the newest frame's picture has been the same."""

    def accept(self, frame: Frame, arrived_ns: int) -> bool:
        """Add the next frame; return whether it differs from the last.

        Args:
            frame: with the time at which it was taken.
            arrived_ns: when it was received, by the same clock.

        Raises:
            PlatformError: its size is another than the last one's.
        """
        last, self._last, self._arrived_ns = self._last, frame, arrived_ns
        if last is None:
            return True
        if last.rgb.shape != frame.rgb.shape:
            was, now = (f"{rgb.shape[1]}x{rgb.shape[0]}" for rgb in (last.rgb, frame.rgb))
            raise PlatformError(f"camera {self._name}: the picture's size changed from {was} to {now} px")
        # Before its people may go, a rehearsal stands still.
        if frame.truth is None and np.array_equal(last.rgb, frame.rgb):
            self._unchanged_s += (frame.t_ns - last.t_ns) / 1e9 / self._speed
            return False
        self._unchanged_s = 0.0
        return True

    def refuse_dead(self, now_ns: int) -> None:
        """Check that frames arrive and change; does nothing before the first.

        Raises:
            PlatformError: the camera is silent, late or frozen.
        """
        if self._last is None:
            return
        silent_s = (now_ns - self._arrived_ns) / 1e9 / self._speed
        if silent_s > SILENT_AFTER_S:
            raise PlatformError(f"camera {self._name}: no picture has come for {silent_s:.1f} s")
        late_s = (self._arrived_ns - self._last.t_ns) / 1e9 / self._speed
        if late_s > SILENT_AFTER_S:
            raise PlatformError(
                f"camera {self._name}: by its time stamps its pictures come {late_s:.1f} s late: the network "
                "or a queue holds them back, or its clock is wrong"
            )
        if self._unchanged_s > FROZEN_AFTER_S:
            raise PlatformError(
                f"camera {self._name}: has given the very same picture for {self._unchanged_s:.1f} s: "
                "it hangs or is covered"
            )
