"""Serves frames as an MJPEG stream over HTTP, as IP cameras and ROS web_video_server do; `mjpeg` reads it.

``GET /stream.mjpg``, or ``/``, is ``multipart/x-mixed-replace``: one JPEG per part with its time and number,
in a rehearsal also with ground truth. Any browser can show it. ``POST /go`` lets the people walk. It listens
on the loopback interface only, and refuses requests for any other host name, so that a web page cannot read
the images by DNS rebinding.
"""

from __future__ import annotations

import base64
import re
import socket
import threading
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import cv2

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import Shot
from adatracker_deploy.page.loopback import LoopbackServer
from adatracker_deploy.perception.truth_wire import encode_truth

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.core.messages import Frame

STREAM_PATH = "/stream.mjpg"
GO_PATH = "/go"
_OWN_NAMES = frozenset({"127.0.0.1", "localhost", "[::1]"})
"""Host names under which local users reach it, on any port (tunnels)."""
_BOUNDARY = "frame"
_JPEG_QUALITY = 90
_SEND_BUFFER_BYTES = 1 << 16
"""Kernel send buffer per client, bytes; small, so that a slow client is not shown old frames."""
_SEND_TIMEOUT_S = 5.0
"""A client that has not taken an image for this long is dropped."""


class MjpegServer:
    """Serves the newest published frame to every client; a slow client skips frames.

    Args:
        port: on 127.0.0.1; 0 takes any free one.

    Raises:
        UsageError: the port is in use.
    """

    def __init__(self, port: int = 0) -> None:
        self._newest = _Newest()
        self._on_go: list[Callable[[], None]] = []
        try:
            self._server = _Server(port, self._newest, self._go)
        except OSError as error:
            raise UsageError(f"TCP port {port} for the camera's stream: {error.strerror}") from error
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), name="mjpeg server")
        self._thread.daemon = True
        self._thread.start()

    @property
    def port(self) -> int:
        """The TCP port that it listens on."""
        return self._server.server_port

    @property
    def url(self) -> str:
        """The stream's address."""
        return f"http://127.0.0.1:{self.port}{STREAM_PATH}"

    def publish(self, frame: Frame | Shot) -> None:
        """Publish a frame; cheap, because it is encoded only in the clients' threads."""
        self._newest.put(frame)

    def on_go(self, callback: Callable[[], None]) -> None:
        """Register a callback for each POST to ``/go``; it runs in a server thread."""
        self._on_go.append(callback)

    def close(self) -> None:
        """End every stream and free the port; may be called twice."""
        self._newest.end()
        self._server.shutdown()
        self._server.disconnect_all()
        self._server.server_close()
        self._thread.join()

    def _go(self) -> None:
        for callback in self._on_go:
            callback()


class _Shot:
    """A published frame and, once requested, its encoded part of the stream."""

    def __init__(self, frame: Frame | Shot) -> None:
        self._frame = frame
        self._encoding = threading.Lock()
        self._part: bytes | None = None

    def part(self) -> bytes:
        """Return the part with its boundary; encoded only once."""
        with self._encoding:
            if self._part is None:
                self._part = _encode(self._frame)
            return self._part


def _jpeg(frame: Frame) -> bytes:
    bgr = cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2BGR)
    return bytes(cv2.imencode(".jpg", bgr, (cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY))[1])


def _encode(frame: Frame | Shot) -> bytes:
    """Return a frame as a part of the stream."""
    jpeg = frame.jpeg if isinstance(frame, Shot) else _jpeg(frame)
    headers = {
        "Content-Type": "image/jpeg",
        "Content-Length": len(jpeg),
        "X-Timestamp": f"{frame.t_ns / 1e9:.6f}",
        "X-Sequence": frame.seq,
    }
    if frame.truth is not None:
        headers["X-Truth"] = base64.b64encode(encode_truth(frame.truth)).decode()
    lines = (f"--{_BOUNDARY}", *(f"{name}: {value}" for name, value in headers.items()), "", "")
    return b"".join(("\r\n".join(lines).encode(), jpeg, b"\r\n"))


class _Newest:
    """Holds the newest shot, and lets clients wait for the next."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._shot: _Shot | None = None
        self._ended = False

    def put(self, frame: Frame | Shot) -> None:
        with self._changed:
            self._shot = _Shot(frame)
            self._changed.notify_all()

    def end(self) -> None:
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def after(self, seen: _Shot | None) -> _Shot | None:
        """Wait for a newer shot than `seen`; None once the server has closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._ended or self._shot is not seen)
            return None if self._ended else self._shot


class _Server(LoopbackServer):
    def __init__(self, port: int, newest: _Newest, go: Callable[[], None]) -> None:
        self.newest = newest
        self.go = go
        super().__init__(port, _Handler)


def _name(host: str) -> str:
    """Return a host without its port, in lower case."""
    return re.sub(r":[0-9]*$", "", host).lower()


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = _SEND_TIMEOUT_S
    disable_nagle_algorithm = True

    def setup(self) -> None:
        self.request.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        super().setup()

    def do_GET(self) -> None:
        if self._refuses():
            return
        if self.path not in ("/", STREAM_PATH):  # people type no path
            self.send_error(HTTPStatus.NOT_FOUND, explain=f"the stream is at {STREAM_PATH}")
            return
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={_BOUNDARY}")
        self.send_header("Cache-Control", "no-store")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        self.end_headers()
        shot = None
        while (shot := self.server.newest.after(shot)) is not None:
            self.wfile.write(shot.part())

    def do_POST(self) -> None:
        if self._refuses():
            return
        if self.path != GO_PATH:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        self.server.go()
        self.send_response(HTTPStatus.NO_CONTENT)
        self.end_headers()

    def _refuses(self) -> bool:
        """Refuse a request made by another site's page; return whether it was one.

        Browsers name the host of every request (RFC 9110, 7.2), and with a POST the origin of the page that
        makes it (RFC 6454, 7).
        """
        host, origin = self.headers.get("Host", "localhost"), self.headers.get("Origin")
        own = _name(host) in _OWN_NAMES and (origin is None or _name(urlsplit(origin).netloc) in _OWN_NAMES)
        if not own:
            self.send_error(HTTPStatus.FORBIDDEN, explain="this page is for its own machine: use 127.0.0.1")
        return not own

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 -- http.server's name
        """Write nothing: stderr belongs to the run."""
