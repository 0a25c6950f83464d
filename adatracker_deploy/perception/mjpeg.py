"""MJPEG cameras over HTTP: IP cameras, mjpg-streamer, ROS web_video_server, rehearsals."""

from __future__ import annotations

import base64
import contextlib
import http.client
import re
import select
import socket
import ssl
from http import HTTPStatus
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

from adatracker_deploy.core.camera import OPEN_TIMEOUT_S, without_password
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.perception.jpeg import decode_jpeg
from adatracker_deploy.perception.live import LiveCamera, Picture
from adatracker_deploy.perception.multipart import MultipartParser, Part
from adatracker_deploy.perception.truth_wire import decode_truth

if TYPE_CHECKING:
    from collections.abc import Generator

    from adatracker_deploy.core.clock import Clock

_RECEIVE_BYTES = 1 << 18
_GO_TIMEOUT_S = 2.0
_TIMESTAMP = re.compile(r"([0-9]{1,12})(?:\.([0-9]{1,9}))?")
"""Seconds, as mjpg-streamer, ROS web_video_server and ESP32 cameras write them into ``X-Timestamp``."""


class MjpegCamera(LiveCamera):
    """Reads a multipart stream of JPEGs; a frame arrives with its last byte, and ``X-Timestamp`` is its
    stamp.

    Args:
        url: ``http://`` or ``https://``; a user and a password in it are sent as Basic authentication.
        clock: the run's.
    """

    def __init__(self, url: str, clock: Clock) -> None:
        super().__init__(without_password(url), clock)
        self._url = urlsplit(url)
        self._socket: socket.socket | None = None

    def go(self) -> None:
        """Let the people of a rehearsal walk; a camera whose frames carry no ground truth gets no request.

        Raises:
            PlatformError: the rehearsal does not answer.
        """
        if not self._frames or self._frames[0].truth is None:
            return
        try:
            with contextlib.closing(self._connection(_GO_TIMEOUT_S)) as connection:
                connection.request("POST", "/go", headers=self._headers())
                status = connection.getresponse().status
        except (OSError, http.client.HTTPException) as error:
            raise PlatformError(f"camera {self.name}: the rehearsal cannot begin: {error}") from error
        if status >= 300:
            raise PlatformError(f"camera {self.name}: the rehearsal cannot begin: POST /go answered {status}")

    def _pictures(self) -> Generator[Picture, None, None]:
        try:
            with contextlib.closing(self._connection(OPEN_TIMEOUT_S)) as connection:
                connection.connect()
                self._socket = connection.sock
                if self._ending.is_set():
                    return
                connection.request("GET", self._path(), headers=self._headers())
                with connection.getresponse() as response:
                    parser = MultipartParser(self._boundary(response))
                    yield from self._stream(response, self._socket, parser)
        except http.client.IncompleteRead:
            return  # in the middle of a chunk, as streams do
        except http.client.HTTPException as error:
            raise PlatformError(f"camera {self.name}: its answer is not HTTP: {error!r}") from error
        except ssl.SSLCertVerificationError as error:
            raise PlatformError(
                f"camera {self.name}: its certificate is not trusted ({error.verify_message}): "
                "name a file with it in SSL_CERT_FILE"
            ) from error
        except TimeoutError as error:
            raise self._silent() from error
        except OSError as error:
            raise PlatformError(f"camera {self.name}: {error.strerror or error}") from error
        except ValueError as error:
            raise PlatformError(f"camera {self.name}: {error}") from error

    def _interrupt(self) -> None:
        if self._socket is not None:
            with contextlib.suppress(OSError):  # it has ended by itself
                self._socket.shutdown(socket.SHUT_RDWR)

    def _stream(
        self, response: http.client.HTTPResponse, wire: socket.socket, parser: MultipartParser
    ) -> Generator[Picture, None, None]:
        """Decode the newest part once nothing more waits in the kernel; older parts are skipped."""
        newest: Part | None = None
        t_ns = 0
        while data := response.read1(_RECEIVE_BYTES):
            if parts := parser.feed(data):
                newest, t_ns = parts[-1], self.clock.now_ns()
            if newest is None or _waits(wire):
                continue
            try:
                picture = decode_part(newest, t_ns, self.clock.speed)
            except ValueError:
                self.dropped += 1
            else:
                yield picture
            newest = None

    def _boundary(self, response: http.client.HTTPResponse) -> str:
        if response.status == HTTPStatus.UNAUTHORIZED:
            raise PlatformError(
                f"camera {self.name}: wants a user: write {self._url.scheme}://USER:PASSWORD@..."
            )
        if response.status != HTTPStatus.OK:
            raise PlatformError(f"camera {self.name}: answered {response.status} {response.reason}")
        kind = response.headers.get_content_type()
        if response.headers.get_content_maintype() != "multipart":
            raise PlatformError(f"camera {self.name}: sends {kind}, expected a multipart stream of JPEGs")
        return response.headers.get_boundary("")

    def _connection(self, timeout_s: float) -> http.client.HTTPConnection:
        host, port = self._url.hostname or "", self._url.port
        if self._url.scheme == "https":
            context = ssl.create_default_context()
            return http.client.HTTPSConnection(
                host, port or http.client.HTTPS_PORT, timeout=timeout_s, context=context
            )
        return http.client.HTTPConnection(host, port or http.client.HTTP_PORT, timeout=timeout_s)

    def _path(self) -> str:
        path = self._url.path or "/"
        return f"{path}?{self._url.query}" if self._url.query else path

    def _headers(self) -> dict[str, str]:
        if self._url.username is None:
            return {}
        user = f"{unquote(self._url.username)}:{unquote(self._url.password or '')}"
        return {"Authorization": f"Basic {base64.b64encode(user.encode()).decode()}"}


def _waits(wire: socket.socket) -> bool:
    """Return whether more of the stream has already arrived."""
    if isinstance(wire, ssl.SSLSocket) and wire.pending():
        return True
    return bool(select.select([wire], [], [], 0)[0])


def decode_part(part: Part, t_ns: int, speed: float = 1.0) -> Picture:
    """Decode a part of the stream.

    Args:
        part: of the stream.
        t_ns: when it arrived, by the run's clock.
        speed: seconds of the run's clock, in which a rehearsal's stamps are, per second of the machine's.

    Raises:
        ValueError: it is not a complete JPEG of an allowed size, or its ``X-Truth`` is invalid.
    """
    truth = part.headers.get("x-truth")
    decoded = decode_truth(base64.b64decode(truth, validate=True)) if truth is not None else None
    stamp_ns = _stamp_ns(part.headers.get("x-timestamp", ""))
    if truth is not None:
        stamp_ns = round(stamp_ns / speed)
    return Picture(decode_jpeg(part.body), t_ns, stamp_ns, decoded, part.body)


def _stamp_ns(text: str) -> int:
    """Return the time in an ``X-Timestamp``; 0 if missing or invalid."""
    time = _TIMESTAMP.fullmatch(text)
    return int(time[1]) * 10**9 + int((time[2] or "").ljust(9, "0")) if time else 0
