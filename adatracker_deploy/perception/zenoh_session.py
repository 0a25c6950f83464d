"""Zenoh sessions with one endpoint, no discovery, a short lease and quick reconnects.

Zenoh's own defaults listen on every interface and look for others by multicast, so that robots on one network
hear each other's commands. Here the host dials one named endpoint and the robot's side listens on it.
Imported only when somebody speaks Zenoh.

A session whose subscribers call back hangs the interpreter at exit unless it was closed: take samples from
channels (``zenoh.handlers.RingChannel``) and use the session as a context manager.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Literal

import zenoh

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.perception.compressed_image import IMAGE_CAP_BYTES

if TYPE_CHECKING:
    from collections.abc import Mapping

CONNECT_TIMEOUT_S = 1.5
"""Time-out of a connection attempt; a robot on the same network answers in milliseconds."""
LEASE_S = 1.0
"""A peer that is silent for this long is gone: how soon a frozen or cut-off robot is noticed."""

_RETRY = {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 1.5}
"""A router that comes back is found again in 0.3 s, measured; by Zenoh's own 1 s to 4 s periods in 4.0 s."""

_LARGEST_BYTES = IMAGE_CAP_BYTES + (64 << 10)
"""No peer can make this one hold more for a message; Zenoh's own cap is 1 GiB."""


def session_config(
    endpoint: str,
    *,
    mode: Literal["client", "peer", "router"] = "client",
    connect_timeout_s: float = CONNECT_TIMEOUT_S,
    lease_s: float = LEASE_S,
    more: Mapping[str, Any] | None = None,
) -> zenoh.Config:
    """Return a session's configuration: a client dials `endpoint`, the others listen on it.

    Args:
        endpoint: such as ``tcp/192.168.1.20:7447``.
        mode: which side this is.
        connect_timeout_s: how long to dial.
        lease_s: silent for longer, a peer is gone.
        more: further settings, by their paths.
    """
    dials = mode == "client"
    settings: dict[str, Any] = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "connect/endpoints": [endpoint] if dials else [],
        "listen/endpoints": [] if dials else [endpoint],
        "connect/timeout_ms": _ms(connect_timeout_s),
        "connect/exit_on_failure": True,
        "connect/retry": _RETRY,
        "transport/link/tx/lease": _ms(lease_s),
        "transport/link/rx/max_message_size": _LARGEST_BYTES,
    }
    config = zenoh.Config()
    for key, value in (settings | dict(more or {})).items():
        config.insert_json5(key, json.dumps(value))
    return config


def dial(endpoint: str) -> zenoh.Session:
    """Dial a router or bridge that asks for no certificate; the session must be closed.

    Raises:
        PlatformError: nobody answers within `CONNECT_TIMEOUT_S`, or not as a Zenoh router or peer would.
    """
    try:
        return zenoh.open(session_config(endpoint))
    except zenoh.ZError as error:
        raise PlatformError(
            f"no Zenoh router or bridge answers at {endpoint} within {CONNECT_TIMEOUT_S:g} s: check that it "
            "runs on the robot and listens there"
        ) from error


def _ms(seconds: float) -> int:
    return round(seconds * 1000)
