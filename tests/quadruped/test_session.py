"""The Zenoh session against real routers and peers on this machine."""

import contextlib
import json
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace

import pytest
import zenoh

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.perception.compressed_image import IMAGE_CAP_BYTES
from adatracker_quadruped.protocol.connection import Connection
from adatracker_quadruped.protocol.session import open_session, zenoh_config
from tests.quadruped.routers import arrives, free_port, latest, publisher_of, robot, until

pytestmark = pytest.mark.slow


@pytest.fixture
def connection():
    return Connection(endpoint=f"tcp/127.0.0.1:{free_port()}")


def test_a_session_looks_for_nobody_and_listens_nowhere(connection):
    config = zenoh_config(connection)
    settings = {
        "mode": "client",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "listen/endpoints": [],
        "connect/endpoints": [connection.endpoint],
        "transport/link/tx/lease": 1000,
    }
    assert {key: json.loads(config.get_json(key)) for key in settings} == settings


@pytest.mark.parametrize("mode", ["router", "peer"])
def test_the_robots_side_listens_and_never_dials(connection, mode):
    config = zenoh_config(connection, mode=mode)
    assert json.loads(config.get_json("connect/endpoints")) == []
    assert json.loads(config.get_json("listen/endpoints")) == [connection.endpoint]


@pytest.mark.parametrize("mode", ["router", "peer"])
def test_messages_cross_both_ways(connection, mode):
    with robot(connection, mode) as far, open_session(connection) as host:
        commands, images = latest(far, "cmd_vel"), latest(host, "camera")
        assert arrives(publisher_of(host, "cmd_vel"), commands, b"walk") == b"walk"
        assert arrives(publisher_of(far, "camera"), images, bytes(40_000)) == bytes(40_000)


def test_nobody_there_is_said_in_one_line_within_two_seconds(connection):
    started = time.monotonic()
    with pytest.raises(PlatformError, match="no Zenoh router or bridge answers at tcp/127") as refusal:
        open_session(connection)
    assert time.monotonic() - started < 2.0
    assert "\n" not in str(refusal.value)


def test_a_port_that_accepts_and_stays_silent_is_nobody():
    with socket.create_server(("127.0.0.1", 0)) as silent:
        endpoint = f"tcp/127.0.0.1:{silent.getsockname()[1]}"
        started = time.monotonic()
        with pytest.raises(PlatformError, match="no Zenoh router"):
            open_session(Connection(endpoint=endpoint))
        assert time.monotonic() - started < 2.0


def test_two_robots_beside_each_other_hear_only_their_own_host(connection):
    other = replace(connection, endpoint=f"tcp/127.0.0.1:{free_port()}")
    with robot(connection) as near, robot(other) as far, open_session(connection) as host:
        mine, theirs = latest(near, "cmd_vel"), latest(far, "cmd_vel")
        assert arrives(publisher_of(host, "cmd_vel"), mine, b"walk") == b"walk"
        assert theirs.try_recv() is None
        assert not list(far.info.routers_zid())
        assert not list(far.info.peers_zid())


def test_the_robot_sees_the_hosts_token_come_and_go(connection):
    with robot(connection) as far:
        tokens = far.liveliness().declare_subscriber("adatracker/*", zenoh.handlers.FifoChannel(8))
        seen = []

        def next_kind():
            if (sample := tokens.try_recv()) is not None:
                seen.append(sample.kind)
            return seen

        with open_session(connection) as host:
            token = host.liveliness().declare_token(connection.host_token)
            until(next_kind)
        until(lambda: len(next_kind()) == 2)
        assert seen == [zenoh.SampleKind.PUT, zenoh.SampleKind.DELETE]
        del token


def test_a_router_that_comes_back_is_found_again_within_a_second(connection):
    with contextlib.ExitStack() as stack:
        with robot(connection) as first:
            host = stack.enter_context(open_session(connection))
            publisher = publisher_of(host, "cmd_vel")
            assert arrives(publisher, latest(first, "cmd_vel"), b"walk") == b"walk"
        until(lambda: not publisher.matching_status.matching)
        assert time_of_dials(connection, 6) < 3.0, "it is looked for every 0.5 s, however long it is away"
        with robot(connection) as second:
            commands = latest(second, "cmd_vel")
            assert until(lambda: publisher.matching_status.matching) < 1.0
            assert arrives(publisher, commands, b"walk") == b"walk"


def time_of_dials(connection, count):
    """Return how many seconds a host takes to dial this often while it is hung up on."""
    host, port = connection.endpoint.removeprefix("tcp/").split(":")
    started = time.monotonic()
    with socket.create_server((host, int(port))) as server:
        server.settimeout(10)
        for _ in range(count):
            server.accept()[0].close()
    return time.monotonic() - started


def test_nobody_can_make_a_session_hold_more_than_the_largest_image(connection):
    largest, hostile = bytes(IMAGE_CAP_BYTES), bytes(2 * IMAGE_CAP_BYTES)
    with robot(connection) as far, open_session(connection) as host:
        images = host.declare_subscriber("camera", zenoh.handlers.FifoChannel(8))
        publisher = publisher_of(far, "camera")
        assert arrives(publisher, images, largest) == largest
        publisher.put(hostile)
        assert arrives(publisher, images, b"small") == b"small"


ROUTER = """
import sys, zenoh
from adatracker_quadruped.protocol.connection import Connection
from adatracker_quadruped.protocol.session import zenoh_config
with zenoh.open(zenoh_config(Connection(endpoint=sys.argv[1]), mode="router")) as session:
    commands = session.declare_subscriber("cmd_vel", zenoh.handlers.RingChannel(1))
    token = session.liveliness().declare_token("robot/alive")
    print("ready", flush=True)
    sys.stdin.read()
"""

DESERTER = """
import sys, zenoh
from adatracker_quadruped.protocol.connection import Connection
from adatracker_quadruped.protocol.session import open_session
session = open_session(Connection(endpoint=sys.argv[1]))
subscriber = session.declare_subscriber("odom", zenoh.handlers.RingChannel(1))
token = session.liveliness().declare_token("adatracker/host")
raise RuntimeError("nobody closed the session")
"""


@contextlib.contextmanager
def program(text, connection):
    command = [sys.executable, "-c", text, connection.endpoint]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize(("fault", "within_s"), [(signal.SIGKILL, 0.5), (signal.SIGSTOP, 2.0)])
def test_a_robot_that_dies_is_missed_at_once_and_one_that_freezes_after_the_lease(
    connection, fault, within_s
):
    with program(ROUTER, connection) as process:
        assert process.stdout.readline() == b"ready\n"
        with open_session(connection) as host:
            publisher = publisher_of(host, "cmd_vel")
            tokens = host.liveliness().declare_subscriber(
                "robot/alive", zenoh.handlers.RingChannel(1), history=True
            )
            until(lambda: publisher.matching_status.matching)
            until(lambda: tokens.try_recv() is not None)
            process.send_signal(fault)
            assert until(lambda: not publisher.matching_status.matching) < within_s
            gone = []
            until(lambda: gone.append(tokens.try_recv()) or gone[-1] is not None, within_s)
            assert gone[-1].kind == zenoh.SampleKind.DELETE
            if fault == signal.SIGSTOP:
                process.send_signal(signal.SIGCONT)
                assert until(lambda: publisher.matching_status.matching) < 1.0


def test_a_program_that_never_closed_its_session_still_ends(connection):
    with robot(connection), program(DESERTER, connection) as process:
        _, complaint = process.communicate(timeout=20)
        assert process.returncode == 1
        assert b"nobody closed the session" in complaint
