"""Serves the operator's page over HTTP, on this machine alone.

| request        | answer                                                                            |
|----------------|-----------------------------------------------------------------------------------|
| `GET /`        | the page, one file that loads nothing else                                        |
| `GET /feed`    | the stream of updates (`feed`)                                                    |
| `POST /choose` | `{"seq", "x", "y"}`: the person there is to be the target; 202 with its `number`  |
| `POST /stop`   | the run is stopped; 200 when the request was made                                 |

All but the page itself need the token. What is refused says `why`.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import json
import math
import re
import threading
from collections import deque
from functools import cache, partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from importlib import resources
from typing import TYPE_CHECKING, Any

from adatracker_deploy.core.messages import Click
from adatracker_deploy.page.access import foreign, knows
from adatracker_deploy.page.address import port_refused
from adatracker_deploy.page.loopback import LoopbackServer

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.page.address import Address
    from adatracker_deploy.page.feed import Feed

LONGEST_BODY_BYTES = 1024
TIMEOUT_S = 5.0
"""A browser that neither sends nor takes anything for so long is let go."""
_WAITING_CLICKS = 8


class PageServer:
    """Shows a feed, and takes what the operator asks for.

    Args:
        address: its port and token.
        feed: what it shows.
        option: with which its port was chosen, for the error.
        stop: stops the run, and returns what became of that; None where there is nothing to stop.
        unchoosable: why nobody can be chosen; empty where somebody can.

    Raises:
        UsageError: the port is in use.
    """

    def __init__(
        self,
        address: Address,
        feed: Feed,
        *,
        option: str,
        stop: Callable[[], str] | None = None,
        unchoosable: str = "",
    ) -> None:
        self._feed = feed
        self._clicks: deque[Click] = deque(maxlen=_WAITING_CLICKS)
        self._numbers = iter(range(1, 1 << 31))
        handler = partial(_Handler, self, address.token)
        self.feed, self.stop, self.unchoosable = feed, stop, unchoosable
        try:
            self._server = LoopbackServer(address.port, handler)
        except OSError as error:
            raise port_refused(address.port, str(error.strerror), "the page", option) from error
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), name="page")
        self._thread.daemon = True
        self._thread.start()

    def clicks(self) -> list[Click]:
        """Return the clicks since the last call, in their order."""
        taken: list[Click] = []
        with contextlib.suppress(IndexError):
            while True:
                taken.append(self._clicks.popleft())
        return taken

    def clicked(self, seq: int, x: float, y: float) -> int:
        """Take a click; return its number."""
        number = next(self._numbers)
        self._clicks.append(Click(number, seq, x, y))
        return number

    def close(self) -> None:
        """End every stream and free the port."""
        self._feed.end()
        self._server.shutdown()
        self._server.disconnect_all()
        self._server.server_close()
        self._thread.join()


@cache
def page() -> tuple[bytes, str]:
    """Return the page and its Content-Security-Policy: its own style, script and server, nothing else."""
    html = resources.files("adatracker_deploy.page").joinpath("page.html").read_text(encoding="utf-8")
    hashes = {}
    for tag in ("style", "script"):
        (content,) = re.findall(f"<{tag}>(.*?)</{tag}>", html, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        hashes[tag] = f"{tag}-src 'sha256-{digest}'"
    policy = (
        f"default-src 'none'; {hashes['style']}; {hashes['script']}; connect-src 'self'; "
        "img-src data:; "
        "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
    )
    return html.encode(), policy


class _Handler(BaseHTTPRequestHandler):
    timeout = TIMEOUT_S
    disable_nagle_algorithm = True

    def __init__(self, owner: PageServer, token: str, *connection: Any) -> None:
        self._owner = owner
        self._token = token
        super().__init__(*connection)  # which serves the request

    def do_GET(self) -> None:
        if self.path == "/":
            if not self._is_foreign():
                html, policy = page()
                self._answer(HTTPStatus.OK, "text/html; charset=utf-8", html, policy)
        elif self.path == "/feed":
            if not self._is_refused():
                self._head(HTTPStatus.OK, "application/octet-stream")
                for update in self._owner.feed.updates():
                    self.wfile.write(update)
        elif not self._is_foreign():
            self._say(HTTPStatus.NOT_FOUND, why="there is nothing here")

    def do_POST(self) -> None:
        if self._is_refused():
            return
        if self.path == "/stop":
            self._stop()
        elif self.path == "/choose":
            self._choose()
        else:
            self._say(HTTPStatus.NOT_FOUND, why="there is nothing here")

    def _stop(self) -> None:
        if self._owner.stop is None:
            self._say(HTTPStatus.CONFLICT, why="there is nothing to stop: no robot is driven")
        else:
            self._say(HTTPStatus.OK, said=self._owner.stop())

    def _choose(self) -> None:
        if self._owner.unchoosable:
            self._say(HTTPStatus.CONFLICT, why=self._owner.unchoosable)
            return
        length = self.headers.get("Content-Length", "")
        if not re.fullmatch(r"\d{1,4}", length, re.ASCII) or int(length) > LONGEST_BODY_BYTES:
            self._say(HTTPStatus.BAD_REQUEST, why=f"expected 1 to {LONGEST_BODY_BYTES} bytes of JSON")
            return
        point = _point(self.rfile.read(int(length)))
        if point is None:
            self._say(HTTPStatus.BAD_REQUEST, why="expected seq, and x and y in fractions of the picture")
        else:
            self._say(HTTPStatus.ACCEPTED, number=self._owner.clicked(*point))

    def _is_foreign(self) -> bool:
        """Refuse a request that is another site's; return whether it was."""
        why = foreign(self.headers.get_all("Host", []), self.headers.get_all("Origin", []))
        if why is not None:
            self._say(HTTPStatus.FORBIDDEN, why=why)
        return why is not None

    def _is_refused(self) -> bool:
        """Refuse a request that is another site's, or comes without the token; return whether it was."""
        if self._is_foreign():
            return True
        known = knows(self._token, self.headers.get_all("Authorization", []))
        if not known:
            why = "the token is not this run's: open the address that it printed"
            self._say(HTTPStatus.UNAUTHORIZED, why=why)
        return not known

    def _say(self, status: HTTPStatus, **answer: Any) -> None:
        self._answer(status, "application/json", json.dumps(answer).encode())

    def _answer(self, status: HTTPStatus, kind: str, body: bytes, policy: str = "default-src 'none'") -> None:
        self._head(status, kind, ("Content-Length", str(len(body))), ("Content-Security-Policy", policy))
        self.wfile.write(body)

    def _head(self, status: HTTPStatus, kind: str, *more: tuple[str, str]) -> None:
        self.send_response(status)
        for name, value in (
            ("Content-Type", kind),
            ("Cache-Control", "no-store"),
            ("Cross-Origin-Resource-Policy", "same-origin"),
            ("Referrer-Policy", "no-referrer"),
            ("X-Content-Type-Options", "nosniff"),
            ("X-Frame-Options", "DENY"),
            *more,
        ):
            self.send_header(name, value)
        self.end_headers()

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 -- http.server's name
        """Write nothing: stderr belongs to the run."""


def _point(body: bytes) -> tuple[int, float, float] | None:
    """Return the frame's number and the point of a click; None where it is none."""
    try:
        asked = json.loads(body)
    except (ValueError, RecursionError):
        return None
    match asked:
        case {"seq": int(seq), "x": int() | float() as x, "y": int() | float() as y}:
            inside = all(not isinstance(value, bool) and 0 <= value <= 1 for value in (x, y))
            if inside and 0 <= seq < 1 << 53 and math.isfinite(x + y):
                return int(seq), float(x), float(y)
    return None
