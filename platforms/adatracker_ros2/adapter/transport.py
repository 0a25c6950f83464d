"""This host's node: its monitor, command publisher, and who else commands the robot."""

from __future__ import annotations

import secrets
import time
from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.core.messages import ZERO
from adatracker_deploy.runtime.ownership import Claim
from adatracker_ros2.adapter.command_publisher import Commander
from adatracker_ros2.adapter.driver import Driver
from adatracker_ros2.adapter.graph import wrong_publishers, wrong_subscriptions
from adatracker_ros2.adapter.monitor import RobotMonitor
from adatracker_ros2.adapter.ownership import Ownership
from adatracker_ros2.protocol.participant import Participant
from adatracker_ros2.protocol.topics import Topics, claimed

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.messages import Twist
    from adatracker_deploy.core.stamps import Reading
    from adatracker_ros2.protocol.connection import Connection
    from adatracker_ros2.protocol.messages import Odometry

_POLL_S = 0.02
_FASTDDS = Path(__file__).with_name("fastdds.xml")
"""Makes others known early; see docs/ros2.md, 3."""


class Wire:
    """A `velocity_adapter.Wire`. Opens everything or nothing; close it from any thread.

    Args:
        connection: to the robot.
        clock: the run's.
        on_rival: called, in the node's thread, as long as another node publishes commands.

    Raises:
        PlatformError: another program on this machine has the robot, or ROS 2 does not start.
    """

    def __init__(self, connection: Connection, clock: Clock, on_rival: Callable[[], None]) -> None:
        topics = Topics(connection)
        self._claim = Claim(claimed(connection))
        try:
            self._participant = Participant(
                connection, f"adatracker_host_{secrets.token_hex(4)}", fastdds=_FASTDDS
            )
        except BaseException:
            self._claim.close()
            raise
        self.watch = RobotMonitor(self._participant, connection, clock)
        self.commander = Commander(self._participant, connection)
        self.ownership = Ownership(self._participant, topics.command, on_rival)
        self.driver = Driver(self._participant, connection)
        self._participant.start()

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
        """Number of messages that were malformed, repeated or could not be read at all."""
        return self.watch.dropped + self._participant.failures

    def claim(self, given_up: Callable[[], bool]) -> str:  # noqa: ARG002 -- nothing to wait for
        """Return nothing: a topic has no owner, see `rival`."""
        return ""

    def rival(self) -> str:
        """Describe who else publishes commands; empty if nobody does."""
        return self.ownership.rival()

    def trouble(self) -> str:
        """Describe why the robot must not be driven any further; empty while it may."""
        if why := self.watch.trouble():
            return why
        return "" if self.commander.matched else f"nobody subscribes to {self.commander.topic}"

    def owned(self) -> bool:
        """Return True: whoever else commands the robot is noticed by `ownership`."""
        return True

    def release(self) -> None:
        """Do nothing: there is no ownership to give back."""

    def drive(self, command: Twist, stamp_ns: int) -> None:
        """Send one velocity."""
        self.commander.drive(command, stamp_ns)

    def stand(self, stamp_ns: int) -> None:
        """Send another zero: ROS 2 has no word for it."""
        self.commander.drive(ZERO, stamp_ns)

    def misfit(self) -> str:
        """Describe a topic that is there with another type or quality of service only; empty without one."""
        node, commander = self._participant.node, self.commander
        commanded = node.get_subscriptions_info_by_topic(commander.topic)
        if why := wrong_subscriptions(commander.topic, commander.type_name, commander.qos, commanded):
            return why
        for heard in self.watch.subscribers:
            there = node.get_publishers_info_by_topic(heard.topic)
            if why := wrong_publishers(heard.topic, heard.type_name, heard.qos, there):
                return why
        return ""

    def publishes(self, topic: str, timeout_s: float) -> bool:
        """Wait, up to a time-out, for anybody who publishes to a topic."""
        deadline_s = time.monotonic() + timeout_s
        while not self._participant.node.count_publishers(topic):
            if time.monotonic() > deadline_s:
                return False
            time.sleep(_POLL_S)
        return True

    def close(self) -> None:
        """Leave the graph and release the robot; may be called twice."""
        self._participant.close()
        self._claim.close()
