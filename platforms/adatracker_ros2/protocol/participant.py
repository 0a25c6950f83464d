"""A node of rclpy with its own context and thread.

Nothing of it is global: no signal handlers, no default context, no log files of ROS.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import threading
from typing import TYPE_CHECKING, Any

from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from adatracker_deploy.core.errors import PlatformError, line_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from adatracker_ros2.protocol.connection import Connection

_LOOK_S = 0.05
"""Longest delay before the thread notices that it should end."""
_JOIN_S = 2.0
_FASTDDS_PROFILES = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")
"""As Fast DDS 3 and 2 name it; read once in a process, with its first participant."""
_ENVIRONMENT = threading.Lock()
"""Held while a context reads the process's environment, which is the only way to tell it its discovery."""


class Participant:
    """One node, spinning in a thread of its own until `close`.

    Args:
        connection: says where to look for others.
        name: the node's.
        namespace: the node's.
        node_class: `Node`, or one of its subclasses.
        parameters: its parameters with their values; without any it has no parameter services.
        fastdds: a file of Fast DDS profiles, for all nodes of this process; an environment that names one
            keeps its own.

    Raises:
        PlatformError: ROS 2 does not start.
    """

    def __init__(
        self,
        connection: Connection,
        name: str,
        *,
        namespace: str = "/",
        node_class: type[Any] = Node,
        parameters: dict[str, Any] | None = None,
        fastdds: Path | None = None,
    ) -> None:
        self.name = name
        self._context = Context()
        self.failures = 0
        """Number of messages that rclpy could not read."""
        try:
            with _discovering(connection, fastdds):
                self._context.init(args=[], domain_id=connection.domain, initialize_logging=False)
                self.node = node_class(
                    name,
                    context=self._context,
                    namespace=namespace,
                    use_global_arguments=False,
                    enable_rosout=False,
                    start_parameter_services=parameters is not None,
                )
                self._executor = SingleThreadedExecutor(context=self._context)
        except Exception as error:  # whatever the middleware raises
            self._context.try_shutdown()
            raise PlatformError(
                f"ROS 2 does not start in domain {connection.domain}: {line_of(error)}"
            ) from error
        for parameter, value in (parameters or {}).items():
            self.node.declare_parameter(parameter, value)
        self._executor.add_node(self.node)
        self._ending = threading.Event()
        self._closing = threading.Lock()
        self._closed = False
        self._thread = threading.Thread(target=self._spin, name=f"ros2 {name}", daemon=True)
        atexit.register(self.close)  # ending the interpreter under a waiting thread of rclpy aborts

    def start(self) -> None:
        """Begin to spin, once everything that is subscribed to is declared."""
        self._thread.start()

    def every(self, period_s: float, call: Callable[[], None]) -> None:
        """Call in the node's thread, by the machine's steady clock."""
        self.node.create_timer(period_s, call, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def close(self) -> None:
        """End the thread and leave the graph; may be called twice."""
        with self._closing:
            if self._closed:
                return
            self._closed = True
            atexit.unregister(self.close)
            self._ending.set()
            if self._thread.is_alive():
                self._thread.join(_JOIN_S)
            self._executor.shutdown()
            self.node.destroy_node()
            self._context.try_shutdown()
            self._context.destroy()

    def _spin(self) -> None:
        while not self._ending.is_set():
            try:
                self._executor.spin_once(timeout_sec=_LOOK_S)
            except ExternalShutdownException:
                return
            except Exception:  # an invalid message must not end the thread that receives all others
                self.failures += 1


@contextlib.contextmanager
def _discovering(connection: Connection, fastdds: Path | None) -> Iterator[None]:
    wanted = {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": connection.discovery.upper(),
        "ROS_STATIC_PEERS": connection.peers,
    }
    with _ENVIRONMENT:
        if fastdds is not None and not any(name in os.environ for name in _FASTDDS_PROFILES):
            wanted |= dict.fromkeys(_FASTDDS_PROFILES, str(fastdds))
        before = {name: os.environ.get(name) for name in (*wanted, "ROS_LOCALHOST_ONLY")}
        os.environ.pop("ROS_LOCALHOST_ONLY", None)  # it is deprecated, and overrides the others
        os.environ.update(wanted)
        try:
            yield
        finally:
            for name, value in before.items():
                if value is None:
                    os.environ.pop(name, None)
                else:
                    os.environ[name] = value
