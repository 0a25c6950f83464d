"""A rehearsal reaches its own simulator and nobody else, whoever listens at the usual addresses."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import signal
import socket
import threading
import time

import pytest
import zenoh

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.platform import Scenario
from adatracker_deploy.registry import load_platform, load_profile
from adatracker_quadruped.platform import QuadrupedPlatform
from adatracker_quadruped.protocol.session import zenoh_config
from adatracker_wheeled.platform import WheeledPlatform
from adatracker_wheeled.sim.socketcand import SocketcandServer
from tests.quadruped.routers import free_port, until

pytestmark = pytest.mark.slow

SOCKETCAND_PORT, ZENOH_PORT = 29536, 7447
"""The usual ones, which the shipped profiles and the programs themselves use."""
AHEAD = Twist(vx=0.5)
FREE_WITHIN_S = 60.0
"""Another test of this machine may have a usual port just now."""


class Sniffer:
    """Somebody else's TCP server: keeps every byte that it is sent, and greets as a real one would."""

    def __init__(self, port: int, greeting: bytes) -> None:
        self.heard = b""
        self._greeting = greeting
        self._listener = _bound(port)
        self._over = False
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        self._listener.settimeout(0.05)
        while not self._over:
            with contextlib.suppress(TimeoutError):
                connection, _ = self._listener.accept()
                with connection, contextlib.suppress(OSError):
                    connection.settimeout(1.0)
                    connection.sendall(self._greeting)
                    while data := connection.recv(4096):
                        self.heard += data

    def close(self) -> None:
        self._over = True
        self._thread.join()
        self._listener.close()


def _bound(port: int) -> socket.socket:
    give_up_s = time.monotonic() + FREE_WITHIN_S
    while True:
        try:
            return socket.create_server(("127.0.0.1", port))
        except OSError:
            assert time.monotonic() < give_up_s, f"TCP port {port} does not become free: end who listens"
            threading.Event().wait(0.1)


def rehearse(name: str) -> None:
    """Drive the simulated robot of a shipped profile whose address is the usual one."""
    cls = load_platform(name)
    profile, clock = load_profile(cls.default_profile, cls), MonotonicClock()
    where = {"wheeled": {"interface": "socketcand", "port": SOCKETCAND_PORT}}.get(
        name, {"endpoint": f"tcp/127.0.0.1:{ZENOH_PORT}"}
    )
    profile = dataclasses.replace(profile, connection=dataclasses.replace(profile.connection, **where))
    with cls.sitl(profile) as sitl, cls(sitl.start(clock, Scenario(seed=1)), clock) as platform:
        platform.connect()
        assert [check for check in platform.preflight() if check.blocking and not check.ok] == []
        platform.engage()
        until(lambda: platform.send(AHEAD, clock.now_ns()) and platform.state().velocity.vx > 0.2)
        platform.disengage()


def test_a_rehearsal_beside_a_foreign_socketcand_sends_it_nothing():
    with contextlib.closing(Sniffer(SOCKETCAND_PORT, b"< hi >")) as foreign:
        rehearse("wheeled")
        assert foreign.heard == b""


def test_a_rehearsal_beside_a_foreign_zenoh_router_sends_it_nothing():
    with contextlib.closing(Sniffer(ZENOH_PORT, b"")) as foreign:
        rehearse("quadruped")
        assert foreign.heard == b""


def test_a_foreign_socketcand_in_the_simulators_place_is_sent_no_frame():
    heard = []
    clock = MonotonicClock()
    profile = load_profile("scout", WheeledPlatform)
    with WheeledPlatform.sitl(profile) as sitl:
        rehearsed = sitl.start(clock, Scenario(seed=1))
        os.kill(sitl.pid, signal.SIGKILL)
        port = rehearsed.connection.port
        foreign = SocketcandServer(until_free(port), heard.append)
        try:
            with (
                WheeledPlatform(rehearsed, clock) as platform,
                pytest.raises(PlatformError, match="not the simulated base that this rehearsal has started"),
            ):
                platform.connect()
        finally:
            foreign.close()
    assert heard == []


def until_free(port: int) -> int:
    _bound(port).close()
    return port


class ForeignRobot:
    """Somebody else's robot at an endpoint: keeps whatever is put on any of its keys."""

    def __init__(self, endpoint: str) -> None:
        connection = dataclasses.replace(
            load_profile("go2", QuadrupedPlatform).connection, endpoint=endpoint, tls=None
        )
        self._session = zenoh.open(zenoh_config(connection, mode="router"))
        self._heard = self._session.declare_subscriber("**", zenoh.handlers.FifoChannel(256))
        self._odometry = self._session.declare_publisher("odom")
        self._token = self._session.liveliness().declare_token("@/foreign/@ros2_lv/robot")

    @property
    def reached(self) -> bool:
        """A host listens to its odometry."""
        return bool(self._odometry.matching_status.matching)

    @property
    def heard(self) -> list[str]:
        return [str(sample.key_expr) for sample in iter(self._heard.try_recv, None)]

    def close(self) -> None:
        self._token.undeclare()
        self._session.close()


def test_a_foreign_robot_in_the_simulators_place_is_sent_not_even_a_stop():
    clock = MonotonicClock()
    with QuadrupedPlatform.sitl(load_profile("go2", QuadrupedPlatform)) as sitl:
        rehearsed = sitl.start(clock, Scenario(seed=1))
        with QuadrupedPlatform(rehearsed, clock) as platform:
            platform.connect()
            platform.engage()
            until(lambda: platform.send(AHEAD, clock.now_ns()) and platform.state().velocity.vx > 0.2)
            os.kill(sitl.pid, signal.SIGKILL)
            until_free(int(rehearsed.connection.endpoint.rpartition(":")[2]))
            with contextlib.closing(ForeignRobot(rehearsed.connection.endpoint)) as foreign:
                with pytest.raises(PlatformError, match=r"the robot is gone|has stopped by itself"):
                    until(lambda: platform.send(AHEAD, clock.now_ns()) is None)
                until(lambda: foreign.reached)  # the session finds its way to whoever is there
                platform.hold("the test says so")
                with pytest.raises(PlatformError, match=r"the robot is gone|another host"):
                    platform.engage()
                with contextlib.suppress(PlatformError):
                    platform.disengage()
                assert foreign.heard == []


def test_a_foreign_robot_from_the_start_is_refused():
    clock, endpoint = MonotonicClock(), f"tcp/127.0.0.1:{free_port()}"
    profile = load_profile("go2", QuadrupedPlatform)
    connection = dataclasses.replace(
        profile.connection, endpoint=endpoint, rehearsal_token="0123456789abcdef"
    )
    with (
        contextlib.closing(ForeignRobot(endpoint)) as foreign,
        QuadrupedPlatform(dataclasses.replace(profile, connection=connection), clock) as platform,
    ):
        with pytest.raises(PlatformError, match="not the simulated robot that this rehearsal has started"):
            platform.connect()
        assert foreign.heard == []
