"""The Zenoh session: one endpoint, nothing found by itself, a short lease, quick reconnects.

Zenoh's own defaults listen on every interface and look for others by multicast, so that robots on one network
hear each other's commands. Here the host dials one named endpoint and the robot's side listens on it.

A session whose subscribers call back hangs the interpreter at exit unless it was closed: take samples from
channels (``zenoh.handlers.RingChannel``) and use the session as a context manager.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import zenoh

from adatracker_deploy.errors import PlatformError, UsageError
from adatracker_quadruped.protocol import IMAGE_CAP_BYTES

if TYPE_CHECKING:
    from adatracker_quadruped.connection import Connection, Tls

_RETRY = {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5}
"""A router that comes back is found again in 0.3 s, measured; by Zenoh's own 1 s to 4 s periods in 4.0 s."""

_LARGEST_BYTES = IMAGE_CAP_BYTES + (64 << 10)
"""No peer can make this one hold more for a message; Zenoh's own cap is 1 GiB."""


def zenoh_config(
    connection: Connection, *, mode: Literal["client", "peer", "router"] = "client"
) -> zenoh.Config:
    """Return a session's configuration: a client dials ``connection.endpoint``, the others listen on it.

    Raises:
        UsageError: a file named in ``connection.tls`` is not there.
    """
    dials = mode == "client"
    settings: dict[str, Any] = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "connect/endpoints": [connection.endpoint] if dials else [],
        "listen/endpoints": [] if dials else [connection.endpoint],
        "connect/timeout_ms": _ms(connection.connect_timeout_s),
        "connect/exit_on_failure": True,
        "connect/retry": _RETRY,
        "transport/link/tx/lease": _ms(connection.lease_s),
        "transport/link/rx/max_message_size": _LARGEST_BYTES,
    }
    if connection.tls is not None:
        settings |= _tls(connection.tls, "connect" if dials else "listen")
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def open_session(connection: Connection) -> zenoh.Session:
    """Dial the robot; the session is a context manager and must be closed.

    Raises:
        PlatformError: nobody answers within ``connect_timeout_s``, or not as a Zenoh router or peer would.
        UsageError: a file named in ``connection.tls`` is not there.
    """
    try:
        return zenoh.open(zenoh_config(connection))
    except zenoh.ZError as error:
        endpoint, waited_s = connection.endpoint, connection.connect_timeout_s
        certified = ", and that connection.tls fits its certificate" if endpoint.startswith("tls/") else ""
        raise PlatformError(
            f"no Zenoh router or bridge answers at {endpoint} within {waited_s:g} s: check that it runs on "
            f"the robot and that connection.endpoint names it{certified}"
        ) from error


def _tls(tls: Tls, side: Literal["connect", "listen"]) -> dict[str, Any]:
    files = {
        "root_ca_certificate": tls.root_ca,
        f"{side}_certificate": tls.certificate,
        f"{side}_private_key": tls.private_key,
    }
    for name in filter(None, files.values()):
        if not Path(name).is_file():
            raise UsageError(f"connection.tls: no such file: {name}")
    settings: dict[str, Any] = {f"transport/link/tls/{key}": name for key, name in files.items() if name}
    mutual = bool(tls.root_ca) if side == "listen" else bool(tls.certificate)
    return settings | {
        "transport/link/tls/enable_mtls": mutual,
        "transport/link/tls/verify_name_on_connect": tls.verify_name,
    }


def _ms(seconds: float) -> int:
    return round(seconds * 1000)
