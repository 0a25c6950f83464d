"""Chooses the live view's port before anything moves, in a process that does not serve it."""

from __future__ import annotations

import importlib.metadata
import socket
from urllib.parse import quote

from adatracker_deploy.core.errors import UsageError

HOST = "127.0.0.1"
DEFAULT_PORT = 8765
"""Where Foxglove looks first."""


def choose_port(port: int) -> int:
    """Check that a live view can be served there; return the port, for 0 one that is free.

    Raises:
        UsageError: the port cannot be had, or the extra `live` is not installed.
    """
    try:
        importlib.metadata.version("websockets")  # not imported: it is the log writer's to load
    except importlib.metadata.PackageNotFoundError as error:
        raise UsageError("--live needs websockets: pip install 'adatracker-deploy[live]'") from error
    with socket.socket() as asked:
        asked.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the server: what just ended is free
        try:
            asked.bind((HOST, port))
        except OSError as error:
            raise port_refused(port, str(error.strerror)) from error
        return int(asked.getsockname()[1])


def port_refused(port: int, reason: str) -> UsageError:
    """Return the error that says so."""
    return UsageError(f"TCP port {port} for the live view: {reason}; choose another with --live PORT")


def websocket_url(port: int) -> str:
    """Return what a viewer is told to connect to."""
    return f"ws://{HOST}:{port}"


def app_url(port: int) -> str:
    """Return the address that opens Foxglove's web application on the view."""
    return f"https://app.foxglove.dev/?ds=foxglove-websocket&ds.url={quote(websocket_url(port), safe='')}"
