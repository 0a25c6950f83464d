"""The Zenoh session against real routers and peers on this machine."""

import json
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import replace

import pytest
import zenoh

from adatracker_deploy.errors import PlatformError, UsageError
from adatracker_quadruped import protocol
from adatracker_quadruped.connection import Connection, Tls
from adatracker_quadruped.session import open_session, zenoh_config


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def until(condition, timeout_s=5.0):
    """Return the seconds until the condition held."""
    started, never = time.monotonic(), threading.Event()
    while not condition():
        assert time.monotonic() - started < timeout_s, "waited in vain"
        never.wait(0.002)
    return time.monotonic() - started


@pytest.fixture
def connection():
    return Connection(endpoint=f"tcp/127.0.0.1:{free_port()}")


@contextmanager
def robot(connection, mode="router"):
    with zenoh.open(zenoh_config(connection, mode=mode)) as session:
        yield session


def latest(session, key):
    return session.declare_subscriber(key, zenoh.handlers.RingChannel(1))


def publisher_of(session, key):
    """Return a publisher that drops nothing."""
    return session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)


def arrives(publisher, subscriber, payload):
    """Publish once the subscriber is known; return what it gets."""
    until(lambda: publisher.matching_status.matching)
    publisher.put(payload)
    got = []
    until(lambda: got.append(subscriber.try_recv()) or got[-1] is not None)
    return got[-1].payload.to_bytes()


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
    with open_after_start(connection) as (host, first):
        publisher = publisher_of(host, "cmd_vel")
        heard = latest(first, "cmd_vel")
        until(lambda: publisher.matching_status.matching)
        del heard
        first.close()
        until(lambda: not publisher.matching_status.matching)
        with robot(connection) as second:
            commands = latest(second, "cmd_vel")
            assert until(lambda: publisher.matching_status.matching) < 1.0
            assert arrives(publisher, commands, b"walk") == b"walk"


@contextmanager
def open_after_start(connection):
    first = zenoh.open(zenoh_config(connection, mode="router"))
    try:
        with open_session(connection) as host:
            yield host, first
    finally:
        first.close()


def test_nobody_can_make_a_session_hold_more_than_the_largest_image(connection):
    with robot(connection) as far, open_session(connection) as host:
        images, publisher = latest(host, "camera"), publisher_of(far, "camera")
        largest, hostile = bytes(protocol.IMAGE_CAP_BYTES), bytes(4 * protocol.IMAGE_CAP_BYTES)
        assert arrives(publisher, images, largest) == largest
        publisher.put(hostile)
        assert arrives(publisher, images, b"small") == b"small"


ROUTER = """
import sys, zenoh
from adatracker_quadruped.connection import Connection
from adatracker_quadruped.session import zenoh_config
with zenoh.open(zenoh_config(Connection(endpoint=sys.argv[1]), mode="router")) as session:
    commands = session.declare_subscriber("cmd_vel", zenoh.handlers.RingChannel(1))
    token = session.liveliness().declare_token("robot/alive")
    print("ready", flush=True)
    sys.stdin.read()
"""

DESERTER = """
import sys, zenoh
from adatracker_quadruped.connection import Connection
from adatracker_quadruped.session import open_session
session = open_session(Connection(endpoint=sys.argv[1]))
subscriber = session.declare_subscriber("odom", zenoh.handlers.RingChannel(1))
token = session.liveliness().declare_token("adatracker/host")
raise RuntimeError("nobody closed the session")
"""


@contextmanager
def program(text, connection):
    command = [sys.executable, "-c", text, connection.endpoint]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize(("fault", "within_s"), [(signal.SIGKILL, 0.2), (signal.SIGSTOP, 1.5)])
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


def test_a_program_that_never_closed_its_session_still_ends(connection):
    with robot(connection), program(DESERTER, connection) as process:
        _, complaint = process.communicate(timeout=20)
        assert process.returncode == 1
        assert b"nobody closed the session" in complaint


def openssl(*arguments, cwd):
    subprocess.run(["openssl", *arguments], cwd=cwd, check=True, capture_output=True)


def issue(name, folder, authority=None):
    """Make a key and a certificate for 127.0.0.1, signed by an authority or by itself."""
    key = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2"]
    signed = ["-CA", f"{authority}.pem", "-CAkey", f"{authority}.key"] if authority else []
    kind = "basicConstraints=critical,CA:FALSE" if authority else "basicConstraints=critical,CA:TRUE"
    openssl(
        *(
            "req",
            "-x509",
            *key,
            *signed,
            "-subj",
            f"/CN={name}",
            "-keyout",
            f"{name}.key",
            "-out",
            f"{name}.pem",
        ),
        *("-addext", "subjectAltName=IP:127.0.0.1", "-addext", kind),
        cwd=folder,
    )


@pytest.fixture(scope="module")
def certificates(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tls")
    issue("authority", folder)
    issue("stranger", folder)
    issue("robot", folder, "authority")
    issue("host", folder, "authority")
    issue("intruder", folder, "stranger")

    def tls(name="", authority="authority"):
        pair = (f"{folder}/{name}.pem", f"{folder}/{name}.key") if name else ("", "")
        return Tls(root_ca=f"{folder}/{authority}.pem", certificate=pair[0], private_key=pair[1])

    return tls


@pytest.fixture
def guarded(certificates):
    """Return the connection of a robot that asks for a certificate."""
    return Connection(
        endpoint=f"tls/127.0.0.1:{free_port()}", tls=certificates("robot"), connect_timeout_s=0.5
    )


def test_a_host_with_a_certificate_gets_through_to_a_robot_that_asks_for_one(guarded, certificates):
    with robot(guarded) as far, open_session(replace(guarded, tls=certificates("host"))) as host:
        assert arrives(publisher_of(host, "cmd_vel"), latest(far, "cmd_vel"), b"walk") == b"walk"


@pytest.mark.parametrize(
    ("name", "authority"),
    [("", "authority"), ("intruder", "authority"), ("host", "stranger")],
    ids=["no certificate", "a stranger's certificate", "a robot nobody vouches for"],
)
def test_without_trust_on_both_sides_there_is_no_session(guarded, certificates, name, authority):
    with robot(guarded), pytest.raises(PlatformError, match=r"connection\.tls fits its certificate"):
        open_session(replace(guarded, tls=certificates(name, authority)))


def test_a_host_in_the_clear_reaches_no_encrypted_robot(guarded):
    plain = replace(guarded, endpoint=guarded.endpoint.replace("tls/", "tcp/"), tls=None)
    with robot(guarded), pytest.raises(PlatformError, match="no Zenoh router"):
        open_session(plain)


def test_a_missing_certificate_file_is_named(connection):
    lost = Connection(endpoint="tls/127.0.0.1:7447", tls=Tls(root_ca="nowhere/ca.pem"))
    with pytest.raises(UsageError, match=r"no such file: nowhere/ca\.pem"):
        open_session(lost)
