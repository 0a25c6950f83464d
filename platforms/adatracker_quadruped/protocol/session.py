"""Opens a connection's Zenoh session: `perception.zenoh_session` with its time-outs and certificates."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import zenoh

from adatracker_deploy.config.secret_file import check_secret
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.perception.zenoh_session import session_config

if TYPE_CHECKING:
    from adatracker_quadruped.protocol.connection import Connection, Tls


def zenoh_config(
    connection: Connection, *, mode: Literal["client", "peer", "router"] = "client"
) -> zenoh.Config:
    """Return a session's configuration: a client dials ``connection.endpoint``, the others listen on it.

    Raises:
        UsageError: a file named in ``connection.tls`` is not there, or others may read the private key.
    """
    return session_config(
        connection.endpoint,
        mode=mode,
        connect_timeout_s=connection.connect_timeout_s,
        lease_s=connection.lease_s,
        more=_tls(connection.tls, "connect" if mode == "client" else "listen") if connection.tls else None,
    )


def open_session(connection: Connection) -> zenoh.Session:
    """Dial the robot; the session is a context manager and must be closed.

    Raises:
        PlatformError: nobody answers within ``connect_timeout_s``, or not as a Zenoh router or peer would.
        UsageError: a file named in ``connection.tls`` is not there, or others may read the private key.
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
    if tls.private_key:
        check_secret(tls.private_key, where="connection.tls")
    settings: dict[str, Any] = {f"transport/link/tls/{key}": name for key, name in files.items() if name}
    mutual = bool(tls.root_ca) if side == "listen" else bool(tls.certificate)
    return settings | {
        "transport/link/tls/enable_mtls": mutual,
        "transport/link/tls/verify_name_on_connect": tls.verify_name,
    }
