"""One open connection to a robot: session, monitor, command publisher and this host's liveliness token."""

from __future__ import annotations

import atexit
import time
from typing import TYPE_CHECKING

import zenoh

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.perception.zenoh_graph import Graph
from adatracker_deploy.runtime.ownership import Claim
from adatracker_quadruped.adapter.command_publisher import Commander
from adatracker_quadruped.adapter.lease import Lease
from adatracker_quadruped.adapter.monitor import RobotMonitor
from adatracker_quadruped.protocol.keys import Keys
from adatracker_quadruped.protocol.rehearsal_keys import SitlKeys
from adatracker_quadruped.protocol.session import open_session

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.messages import Twist
    from adatracker_deploy.core.stamps import Reading
    from adatracker_quadruped.protocol.connection import Connection
    from adatracker_quadruped.protocol.messages import Odometry

_POLL_S = 0.02
_ANSWER_S = 0.3
"""Time for a router to report its tokens."""


class Wire:
    """A `velocity_adapter.Wire`. Opens everything or nothing; close it from any thread.

    Raises:
        PlatformError: nothing answers at the endpoint, another program on this machine has the robot, or the
            robot is not the one that this rehearsal has started.
        UsageError: a file that the connection names is not there.
    """

    def __init__(self, connection: Connection, clock: Clock) -> None:
        self._claim = Claim(connection.robot)
        self._token = connection.host_token
        try:
            self._session = open_session(connection)
        except BaseException:
            self._claim.close()
            raise
        try:
            self._require_own_rehearsal(connection)
            self.watch = RobotMonitor(self._session, connection, clock)
            self.commander = Commander(self._session, connection, self.watch.meant)
            self._graph = Graph(self._session)
            keys = Keys(connection)
            self._graph.publishes(keys.command)
            for key in (keys.odometry, keys.imu, keys.battery):
                self._graph.subscribes(key)
            self.lease = Lease(self._session, connection.host_token)
            self.lease.take()
        except BaseException:
            self._session.close()
            self._claim.close()
            raise
        atexit.register(self.close)  # ending the interpreter under a waiting subscriber aborts

    @property
    def odometry(self) -> Reading[Odometry] | None:
        """The newest odometry, None before the first."""
        return self.watch.odometry.newest

    @property
    def battery(self) -> Reading[float | None] | None:
        """The newest charge."""
        return self.watch.battery.newest if self.watch.battery is not None else None

    @property
    def dropped(self) -> int:
        """Number of malformed messages."""
        return self.watch.dropped

    def claim(self, given_up: Callable[[], bool]) -> str:
        """Take the lease; return why it cannot be had."""
        return "" if self.lease.take(given_up) else f"another host holds {self._token}: end it first"

    def rival(self) -> str:
        """Return nothing: whoever has the lease is alone, and who has lost it is in `trouble`."""
        return ""

    def trouble(self) -> str:
        """Describe why the robot must not be driven any further; empty while it may."""
        if why := self.watch.trouble() or self.lease.lost():
            return why
        return "" if self.commander.matched else f"nobody subscribes to {self.commander.key}"

    def owned(self) -> bool:
        """Return whether this host has the lease."""
        return not self.lease.lost()

    def release(self) -> None:
        """Give the lease back."""
        self.lease.release()

    def drive(self, command: Twist, stamp_ns: int) -> None:
        """Send one velocity."""
        self.commander.walk(command, stamp_ns)

    def stand(self, stamp_ns: int) -> None:
        """Announce that no command will follow."""
        self.commander.stand(stamp_ns)

    def hears(self, key: str, timeout_s: float) -> bool:
        """Wait, up to a time-out, for any message on a key."""
        deadline_s = time.monotonic() + timeout_s
        subscriber = self._session.declare_subscriber(key, zenoh.handlers.RingChannel(1))
        self._graph.subscribes(key)
        try:
            while subscriber.try_recv() is None:
                if time.monotonic() > deadline_s:
                    return False
                time.sleep(_POLL_S)
            return True
        finally:
            subscriber.undeclare()

    def close(self) -> None:
        """Drop the token, which stops a robot that monitors it; close the session; wait for the
        subscribers."""
        atexit.unregister(self.close)
        self.lease.release()
        self._session.close()
        self.watch.join()
        self._claim.close()

    def _require_own_rehearsal(self, connection: Connection) -> None:
        """Make sure, in a rehearsal, that the robot here is the one that it has started."""
        run = SitlKeys(connection).run
        deadline_s = time.monotonic() + connection.connect_timeout_s
        while run and not any(reply.ok for reply in self._session.liveliness().get(run, timeout=_ANSWER_S)):
            if time.monotonic() > deadline_s:
                raise PlatformError(
                    f"what answers at {connection.endpoint} is not the simulated robot that this rehearsal "
                    "has started: nothing was sent to it; rehearse again"
                )
            time.sleep(_POLL_S)
