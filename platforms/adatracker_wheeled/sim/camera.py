"""The simulated base's camera on an MJPEG server, which can freeze or fail on command."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from adatracker_deploy.core.faults import CAMERA_FREEZE, CAMERA_GONE
from adatracker_deploy.perception.mjpeg_server import MjpegServer

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.core.messages import Shot


class FailingCamera:
    """Serves the newest frame, unless something is wrong.

    Args:
        port: as for `MjpegServer`.
        go: called when somebody lets the people walk.

    Raises:
        UsageError: the port is in use.
    """

    def __init__(self, port: int, go: Callable[[], None]) -> None:
        self._go = go
        self._changing = threading.Lock()
        self._frozen = False
        self._last: Shot | None = None
        self._server: MjpegServer | None = None
        self._open(port)

    def publish(self, shot: Shot) -> None:
        """Show a picture from now on; a frozen camera shows its last one again, with its number and truth."""
        with self._changing:
            if not self._frozen or self._last is None:
                self._last = shot
            if self._server is not None:
                self._server.publish(self._last)

    def apply_faults(self, faults: frozenset[str]) -> None:
        """Have these faults from now on, and no others; from any thread."""
        with self._changing:
            self._frozen = CAMERA_FREEZE.name in faults
            if CAMERA_GONE.name in faults:
                self._close()
            elif self._server is None:
                self._open(self.port)

    def close(self) -> None:
        """End every stream; may be called twice."""
        with self._changing:
            self._close()

    def _open(self, port: int) -> None:
        self._server = MjpegServer(port)
        self._server.on_go(self._go)
        self.port, self.url = self._server.port, self._server.url

    def _close(self) -> None:
        server, self._server = self._server, None
        if server is not None:
            server.close()
