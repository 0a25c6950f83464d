"""Serves a policy to robots elsewhere, by openpi's protocol (docs/remote.md): each connection has its own."""

from __future__ import annotations

import hmac
import http
import logging
import ssl
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import Box, MaskClass, Observation
from adatracker_deploy.policy.contract import Observed, written
from adatracker_deploy.policy.msgpack_numpy import LARGEST_BYTES, pack, unpack

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from websockets.http11 import Request, Response
    from websockets.sync.server import Server, ServerConnection

    from adatracker_deploy.policy.base import Policy

HEALTH = "/healthz"
"""Health check: answers 200 while the server runs; openpi's own path."""
OBSERVED: tuple[Observed, ...] = ("mask", "box", "confidence")
"""The inputs of this toolkit's policies."""


def served(
    load: Callable[[], Policy],
    *,
    host: str = "127.0.0.1",
    port: int = 0,
    token: str = "",
    certificate: Path | None = None,
    key: Path | None = None,
) -> Server:
    """Return a server that listens; its ``serve_forever`` and ``shutdown`` run and end it.

    Args:
        load: gives each connection a policy of its own, since policies remember.
        host: address to listen on.
        port: 0 for any.
        token: what a client must send as ``Authorization: Api-Key TOKEN``; empty for anybody.
        certificate: PEM file, for ``wss://``.
        key: its private key.

    Raises:
        UsageError: the policy is refused, the address is taken, or the certificate cannot be used.
    """
    from websockets.sync.server import serve

    load()  # what is wrong with it is said before anybody connects

    def checked(connection: ServerConnection, request: Request) -> Response | None:
        if request.path == HEALTH:
            return connection.respond(http.HTTPStatus.OK, "OK\n")
        said = request.headers.get("Authorization", "").encode(errors="replace")
        if token and not hmac.compare_digest(said, f"Api-Key {token}".encode()):
            return connection.respond(http.HTTPStatus.UNAUTHORIZED, "wrong or no token\n")
        return None

    quiet = logging.getLogger(f"{__name__}.websockets")
    quiet.disabled = True  # a client that connects and leaves is not an event
    try:
        return serve(
            lambda connection: _converse(connection, load),
            host,
            port,
            ssl=None if certificate is None else _tls(certificate, key),
            process_request=checked,
            origins=[None],  # no page in a browser: robots send none
            compression=None,
            max_size=LARGEST_BYTES,
            close_timeout=1.0,
            logger=quiet,
        )
    except OSError as error:
        raise UsageError(f"serve {host}:{port}: {error.strerror or error}") from error


def answer(policy: Policy, said: Any) -> dict[str, Any]:
    """Return the answer to an observation.

    Raises:
        ValueError: it is not an observation.
    """
    if not isinstance(said, dict):
        raise ValueError("an observation is a map")  # noqa: TRY004 -- one kind of error for a bad message
    observation, seed = _observation(said), _whole(said, "reset", None)
    if seed is not None:
        policy.reset(seed)
    began_s = time.monotonic()
    action = policy.act(observation)
    taken_ms = (time.monotonic() - began_s) * 1e3
    found: dict[str, Any] = {"actions": action.values, "server_timing": {"infer_ms": taken_ms}}
    if "request" in said:
        found["request"] = said["request"]
    if action.context is not None:
        found["context"] = action.context
    if action.searching:
        found["searching"] = True
    return found


def _converse(connection: ServerConnection, load: Callable[[], Policy]) -> None:
    from websockets.exceptions import ConnectionClosed
    from websockets.frames import CloseCode

    try:
        policy = load()
        connection.send(pack(written(policy.info, OBSERVED)))
        while True:
            message = connection.recv()
            said = unpack(message if isinstance(message, bytes) else message.encode())
            connection.send(pack(answer(policy, said)))
    except ConnectionClosed:
        return
    except (ValueError, UsageError) as error:  # said as openpi's servers do: a text, and the end
        connection.send(str(error))
        connection.close(CloseCode.INVALID_DATA, "not an observation")


def _tls(certificate: Path, key: Path | None) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    # None is ever used again, and one that a client's reading thread takes in while its other thread sends
    # the opening request stops both (websockets 17.4, Python 3.11: 5 of 3,000 connections; without, none).
    context.num_tickets = 0
    try:
        context.load_cert_chain(certificate, key)
    except (OSError, ssl.SSLError) as error:
        raise UsageError(f"serve: {certificate}, {key}: {error.strerror or error}") from error
    return context


def _observation(said: dict[str, Any]) -> Observation:
    mask, box = said.get("mask"), said.get("box")
    if not isinstance(mask, np.ndarray) or mask.dtype != np.uint8 or mask.ndim != 2 or not mask.size:
        raise ValueError("an observation needs a mask, uint8 of shape (H, W)")
    if mask.max() > max(MaskClass):
        raise ValueError(f"a mask with the class {mask.max()}: the last is {max(MaskClass):d}")
    if box is not None and (
        not isinstance(box, np.ndarray)
        or box.shape != (4,)
        or box.dtype.kind not in "fiu"
        or not np.isfinite(box).all()
    ):
        raise ValueError("a box is four numbers: centre and size in fractions of the picture")
    confidence = said.get("confidence", 1.0)
    if not isinstance(confidence, int | float) or not 0.0 <= confidence <= 1.0:
        raise ValueError("a confidence is 0 to 1")
    return Observation(
        mask=mask,
        box=None if box is None else Box(*map(float, box)),
        confidence=float(confidence),
        t_ns=_whole(said, "t_ns", 0) or 0,
        seq=_whole(said, "seq", 0) or 0,
    )


def _whole(said: dict[str, Any], name: str, default: int | None) -> int | None:
    found = said.get(name, default)
    if found is not None and (not isinstance(found, int) or isinstance(found, bool)):
        raise ValueError(f"{name} is a whole number")
    return found
