"""Live video: a camera device, a network stream or a GStreamer pipeline."""

from __future__ import annotations

import contextlib
import socket
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import cv2

from adatracker_deploy.core.camera import OPEN_TIMEOUT_S, without_password
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.perception.capture import Capture
from adatracker_deploy.perception.frame_monitor import SILENT_AFTER_S
from adatracker_deploy.perception.live import LiveCamera, Picture

if TYPE_CHECKING:
    from collections.abc import Generator

    from adatracker_deploy.core.clock import Clock

GSTREAMER = "gst:"
DEVICE = "/dev/"
_RTSP_PORTS = {"rtsp": 554, "rtsps": 322}
"""RFC 7826, section 4.2, and the registry it refers to."""
_REACH_TIMEOUT_S = 1.5
_STREAM_SETTINGS = (
    *(cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, round((OPEN_TIMEOUT_S - 0.5) * 1e3)),
    *(cv2.CAP_PROP_READ_TIMEOUT_MSEC, round((SILENT_AFTER_S + 1.0) * 1e3)),
)
"""OpenCV gives up on opening just before `LiveCamera.open` does, and on a next frame after `FrameMonitor`."""


class VideoCamera(LiveCamera):
    """A device (``/dev/video0``), ``rtsp://``, ``rtsps://``, ``udp://``, ``tcp://`` or ``gst:PIPELINE``.

    A frame arrives when OpenCV has it. What a stream sent while OpenCV was finding out what it is comes
    first, late and in quick succession. RTSP's frames carry the sender's time (RFC 3550); that of others may
    be made up from the frame rate, and is not read.
    """

    def __init__(self, uri: str, clock: Clock) -> None:
        super().__init__(without_password(uri), clock)
        self._uri = uri
        self._stamped = urlsplit(uri).scheme in _RTSP_PORTS

    @property
    def hides_delay(self) -> bool:
        """A stream that is not known to state the time, which no device has to."""
        return super().hides_delay and not self._uri.startswith(DEVICE)

    def _pictures(self) -> Generator[Picture, None, None]:
        try:
            self._reach()
            with contextlib.closing(self._capture()) as capture:
                while capture.grab():
                    t_ns, stamp_ns = self.clock.now_ns(), capture.at_ns if self._stamped else 0
                    yield Picture(capture.rgb(), t_ns, stamp_ns)
        except OSError as error:
            raise PlatformError(f"camera {self.name}: {error.strerror or error}") from error
        except ValueError as error:
            raise PlatformError(f"camera {self.name}: {error}") from error

    def _interrupt(self) -> None:
        """Do nothing: OpenCV cannot be interrupted; the reader ends with its next picture or time-out."""

    def _reach(self) -> None:
        """Connect to a stream's port first: OpenCV does not report why it could not open a stream.

        Raises:
            OSError: nothing listens there.
        """
        url = urlsplit(self._uri)
        if url.scheme in _RTSP_PORTS:
            address = (url.hostname or "", url.port or _RTSP_PORTS[url.scheme])
            socket.create_connection(address, _REACH_TIMEOUT_S).close()

    def _capture(self) -> Capture:
        if self._uri.startswith(GSTREAMER):
            return Capture(self._uri.removeprefix(GSTREAMER), cv2.CAP_GSTREAMER)
        if self._uri.startswith(DEVICE):
            return Capture(self._uri, cv2.CAP_V4L2)
        return Capture(self._uri, settings=_STREAM_SETTINGS)
