"""Chooses the live view's port before anything moves, in a process that does not serve it."""

from __future__ import annotations

import importlib.metadata
from urllib.parse import quote

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.page import address
from adatracker_deploy.page.address import HOST, free_port

DEFAULT_PORT = 8765
"""Foxglove's default."""


def choose_port(port: int) -> int:
    """Check that a live view can be served there; return the port, for 0 one that is free.

    Raises:
        UsageError: the port cannot be had, or the extra `live` is not installed.
    """
    try:
        importlib.metadata.version("websockets")  # not imported: it is the log writer's to load
    except importlib.metadata.PackageNotFoundError as error:
        raise UsageError("--live needs websockets: pip install 'adatracker-deploy[live]'") from error
    return free_port(port, "the live view", "--live")


def port_refused(port: int, reason: str) -> UsageError:
    """Return the error for a port that cannot be had."""
    return address.port_refused(port, reason, "the live view", "--live")


def websocket_url(port: int) -> str:
    """Return the address that a viewer connects to."""
    return f"ws://{HOST}:{port}"


def app_url(port: int) -> str:
    """Return the address that opens Foxglove's web application on the view."""
    return f"https://app.foxglove.dev/?ds=foxglove-websocket&ds.url={quote(websocket_url(port), safe='')}"
