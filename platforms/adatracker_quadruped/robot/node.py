"""The node for a bare Go2, between ROS 2 messages over Zenoh and Unitree's sport service over DDS.

A Go2 takes sport requests and tells a SportModeState; it has no ``cmd_vel`` and no ``odom``. This node
listens for hosts, walks the robot by their commands and stops it when they cease. It tells them odometry, IMU
and charge on the topics of the profile, so that such a robot looks like any other. It runs on the robot's own
computer (``adatracker-go2.service``), or on another one of its network.
"""

from __future__ import annotations

import argparse
import dataclasses
import signal
import sys
import threading
import time
from typing import TYPE_CHECKING, Any

import zenoh

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError, UsageError, line_of
from adatracker_deploy.registry import load_platform, load_profile
from adatracker_deploy.runtime.pacer import Pacer
from adatracker_quadruped.protocol import sport
from adatracker_quadruped.protocol.command_decoder import STALE_S, CommandDecoder
from adatracker_quadruped.protocol.keys import Keys
from adatracker_quadruped.protocol.messages import Malformed, encode_battery, encode_imu, encode_odometry
from adatracker_quadruped.protocol.publisher import Publisher
from adatracker_quadruped.protocol.session import zenoh_config
from adatracker_quadruped.protocol.unitree import decode_low_state, decode_sport_imu, decode_sport_mode_state
from adatracker_quadruped.robot.walker import STOPS, Walker

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Twist
    from adatracker_quadruped.protocol.connection import Connection
    from adatracker_quadruped.robot.dds import Go2

RATE_HZ = 50.0
_DEAF_S = 0.2
"""After a gap of this process in which commands may have piled up, all of them are dropped for so long."""
_FAILED = 1


class Node:
    """One Go2 for the hosts that reach its endpoint.

    Args:
        connection: where it listens and what it speaks; its `command_timeout_s` is kept here.
        go2: the robot.

    Raises:
        PlatformError: it cannot listen there.
    """

    def __init__(self, connection: Connection, go2: Go2) -> None:
        self._connection, self._go2 = connection, go2
        self._walker = Walker(connection.command_timeout_s)
        self._decoder = CommandDecoder(connection)
        try:
            self._session = zenoh.open(zenoh_config(connection, mode="router"))
        except zenoh.ZError as error:
            raise PlatformError(f"cannot listen at {connection.endpoint}: {line_of(error)}") from error
        keys, live = Keys(connection), self._session.liveliness()
        latest = zenoh.handlers.RingChannel
        self._commands = self._session.declare_subscriber(keys.command, latest(1))
        self._hosts = live.declare_subscriber(connection.host_token, latest(64), history=True)
        self._token = live.declare_token(keys.robot_token) if keys.robot_token else None
        self._odometry = self._publisher(keys.odometry)
        self._imu = self._publisher(keys.imu)
        self._battery = self._publisher(keys.battery)

    def serve(self, ended: threading.Event) -> None:
        """Run until asked to end; a robot that walks is stopped first."""
        pacer, looked_s, deaf_until_s = Pacer(MonotonicClock(), RATE_HZ), time.monotonic(), 0.0
        try:
            while not ended.is_set():
                pacer.wait()
                now_s = time.monotonic()
                if now_s - looked_s > STALE_S:
                    deaf_until_s = now_s + _DEAF_S
                looked_s = now_s
                command, host_left = self._command(), self._host_left()
                self._ask(
                    self._walker.step(now_s, None if now_s < deaf_until_s else command, host_left=host_left)
                )
                self._tell()
        finally:
            for _ in range(STOPS if self._walker.walks else 0):
                self._ask("stop")
            self._session.close()

    def _command(self) -> Twist | None:
        sample = self._commands.try_recv()
        if sample is None:
            return None
        attached = bytes(sample.attachment) if sample.attachment is not None else None
        return self._decoder.take(bytes(sample.payload), attached, time.time_ns())

    def _host_left(self) -> bool:
        left = False
        while (change := self._hosts.try_recv()) is not None:
            left = change.kind == zenoh.SampleKind.DELETE
        return left

    def _ask(self, wish: Twist | str | None) -> None:
        if wish is None:
            return
        number = time.time_ns()
        self._go2.ask(sport.encode_stop(number) if isinstance(wish, str) else sport.encode_move(wish, number))

    def _tell(self) -> None:
        """Pass on what the robot has said since; what is malformed, as before it stands, is left out."""
        now_ns = time.time_ns()
        state, low = self._go2.state(), self._go2.low_state()
        if state is not None:
            self._put(self._odometry, state, now_ns, self._as_odometry)
            self._put(self._imu, state, now_ns, lambda payload: encode_imu(decode_sport_imu(payload)))
        if low is not None:
            self._put(self._battery, low, now_ns, self._as_battery)

    def _as_odometry(self, payload: bytes) -> bytes:
        odometry = decode_sport_mode_state(payload)
        return payload if self._connection.odometry == "sport_mode_state" else encode_odometry(odometry)

    def _as_battery(self, payload: bytes) -> bytes:
        charge = decode_low_state(payload)
        return payload if self._connection.battery == "low_state" else encode_battery(charge, time.time_ns())

    def _put(self, publisher: Publisher | None, payload: bytes, now_ns: int, translate: Any) -> None:
        if publisher is None:
            return
        try:
            translated = translate(payload)
        except Malformed:
            return
        publisher.put(translated, now_ns)

    def _publisher(self, key: str) -> Publisher | None:
        return Publisher(self._session, key, attaches=Keys(self._connection).attaches) if key else None


def main(argv: list[str] | None = None) -> int:
    """Run the node until SIGTERM or Ctrl-C; return the exit status."""
    args = _arguments().parse_args(argv)
    ended = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: ended.set())
    try:
        connection = load_profile(args.profile, load_platform("quadruped")).connection
        connection = dataclasses.replace(connection, endpoint=args.listen)
        try:
            from adatracker_quadruped.robot.dds import Go2
        except ImportError as error:
            raise UsageError(f"the node needs {error.name}: pip install 'adatracker-deploy[go2]'") from error
        node = Node(connection, Go2(args.interface, args.domain))
    except (UsageError, PlatformError) as error:
        print(f"adatracker-go2: {error}", file=sys.stderr)
        return 2 if isinstance(error, UsageError) else _FAILED
    print(f"adatracker-go2: hosts dial {args.listen}", flush=True)
    node.serve(ended)
    return 0


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m adatracker_quadruped.robot", description="The node that a bare Unitree Go2 lacks."
    )
    parser.add_argument("--interface", default="", help="of the robot's own network, such as eth0")
    parser.add_argument("--domain", type=int, default=0, help="DDS domain; default %(default)s")
    parser.add_argument("--profile", default="go2", help="topics and time-out; default %(default)s")
    parser.add_argument("--listen", default="tcp/0.0.0.0:7447", help="where hosts dial; default %(default)s")
    return parser
