"""A port of this machine for somebody who binds it a moment later."""

from __future__ import annotations

import random
import socket

from adatracker_deploy.core.errors import PlatformError

_HERE = "127.0.0.1"
BY_NUMBER = range(20_000, 32_768)
"""Ports that a program has only if it asks for them by number: those that systems give to any socket without
one begin at 32768 on Linux (`ip_local_port_range` in ip(7)) and at 49152 elsewhere (RFC 6335, section 6)."""


def unused_port(kind: socket.SocketKind) -> int:
    """Return a port of 127.0.0.1 that nobody has, and that the system gives to nobody meanwhile.

    What the system itself chooses for port 0 is free again once it is let go, and may be the next socket's.

    Args:
        kind: SOCK_STREAM or SOCK_DGRAM.

    Raises:
        PlatformError: none was found.
    """
    for port in random.SystemRandom().sample(BY_NUMBER, len(BY_NUMBER)):
        with socket.socket(socket.AF_INET, kind) as probe:
            try:
                probe.bind((_HERE, port))
            except OSError:
                continue
            return port
    raise PlatformError(f"no free port on {_HERE} from {BY_NUMBER[0]} to {BY_NUMBER[-1]}")
