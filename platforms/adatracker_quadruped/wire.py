"""One open connection to a robot: a session, what is heard, what is sent, and the token that says we live."""

from __future__ import annotations

import atexit
import time
from typing import TYPE_CHECKING

import zenoh

from adatracker_quadruped.commander import Commander
from adatracker_quadruped.session import open_session
from adatracker_quadruped.watch import Watch

if TYPE_CHECKING:
    from adatracker_deploy.runtime.clock import Clock
    from adatracker_quadruped.connection import Connection

_RIVAL_LEAVES_S = 0.3
"""The token of a host that has just closed may still be on its way out."""
_POLL_S = 0.02


class Wire:
    """Opens everything or nothing; close it from any thread.

    Raises:
        PlatformError: nobody answers at the endpoint.
        UsageError: a file that the connection names is not there.
    """

    def __init__(self, connection: Connection, clock: Clock) -> None:
        self._session = open_session(connection)
        try:
            self.watch = Watch(self._session, connection, clock)
            self.commander = Commander(self._session, connection)
            self.has_rival = self._finds_rival(connection.host_token)
            """Another host, which was there first, holds the same token."""
            self._token = self._session.liveliness().declare_token(connection.host_token)
        except BaseException:
            self._session.close()
            raise
        atexit.register(self.close)  # an interpreter that ends under a waiting tap aborts

    def hears(self, key: str, timeout_s: float) -> bool:
        """Wait, so long at most, for anything on a key."""
        deadline_s = time.monotonic() + timeout_s
        subscriber = self._session.declare_subscriber(key, zenoh.handlers.RingChannel(1))
        try:
            while subscriber.try_recv() is None:
                if time.monotonic() > deadline_s:
                    return False
                time.sleep(_POLL_S)
            return True
        finally:
            subscriber.undeclare()

    def close(self) -> None:
        """Let the token go, which stops a robot that watches it; close the session; wait for the taps."""
        atexit.unregister(self.close)
        self._token.undeclare()
        self._session.close()
        self.watch.join()

    def _finds_rival(self, token: str) -> bool:
        deadline_s = time.monotonic() + _RIVAL_LEAVES_S
        while any(reply.ok for reply in self._session.liveliness().get(token, timeout=_RIVAL_LEAVES_S)):
            if time.monotonic() > deadline_s:
                return True
            time.sleep(_POLL_S)
        return False
