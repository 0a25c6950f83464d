"""The router's configuration in docs/zenoh.md lets a follower do its work, and nothing else."""

import re
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
import zenoh

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_quadruped.adapter.transport import Wire
from adatracker_quadruped.protocol.connection import Tls
from adatracker_quadruped.protocol.messages import Odometry, decode_twist, encode_odometry
from adatracker_quadruped.protocol.publisher import Publisher
from adatracker_quadruped.protocol.session import open_session
from tests.quadruped.certificates import issue
from tests.quadruped.rehearsal import rehearsed
from tests.quadruped.routers import free_port, latest, until

DOCUMENT = Path(__file__).parents[2] / "docs" / "zenoh.md"
TOKEN = "@/0123/@ros2_lv/0"


def written():
    (text,) = re.findall(r"```json5\n(.*?)```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL)
    return text


def documented(port):
    """The document's configuration, with the loopback interface instead of certificates."""
    text = written().replace("tls/0.0.0.0:7447", f"tcp/127.0.0.1:{port}")
    text = text.replace('cert_common_names: ["adatracker-host"]', 'interfaces: ["lo"]')
    text = re.sub(r"tls: \{.*?\},\n", "", text, flags=re.DOTALL)
    text = re.sub(r"  plugins: \{.*?\n  \},\n", "", text, flags=re.DOTALL)
    return zenoh.Config.from_json5(text)


def guarded(port, folder):
    """The document's configuration with its certificates, from a folder; its robot is on the loopback."""
    text = written().replace("tls/0.0.0.0:7447", f"tls/127.0.0.1:{port}").replace("/etc/zenoh", str(folder))
    return zenoh.Config.from_json5(re.sub(r"  plugins: \{.*?\n  \},\n", "", text, flags=re.DOTALL))


@contextmanager
def bridge(connection):
    with zenoh.open(documented(int(connection.endpoint.rpartition(":")[2]))) as session:
        yield session


@pytest.fixture
def connection():
    return rehearsed(endpoint=f"tcp/127.0.0.1:{free_port()}").connection


def test_zenoh_knows_every_word_of_it():
    config = zenoh.Config.from_json5(written())
    assert config.get_json("access_control/enabled") == "true"


def test_a_follower_commands_hears_and_sees_whether_the_robot_lives(connection):
    with bridge(connection) as robot:
        token = robot.liveliness().declare_token(TOKEN)
        commands = latest(robot, "cmd_vel")
        hosts = robot.liveliness().declare_subscriber(connection.host_token, zenoh.handlers.RingChannel(4))
        odometry = Publisher(robot, "odom", attaches=False)
        wire = Wire(connection, MonotonicClock())
        try:
            assert wire.lease.owned
            until(lambda: hosts.try_recv() is not None)

            def heard():
                odometry.put(encode_odometry(Odometry(Pose(), ZERO, time.time_ns())), 0)
                return wire.watch.odometry.newest is not None

            until(heard)
            heard()
            assert wire.watch.trouble() == ""
            until(lambda: wire.commander.matched)
            wire.commander.walk(Twist(vx=0.5), time.time_ns())
            got = []
            until(lambda: got.append(commands.try_recv()) or got[-1] is not None)
            assert decode_twist(bytes(got[-1].payload)) == Twist(vx=0.5)
            token.undeclare()
            until(lambda: "is gone" in wire.watch.trouble())
        finally:
            wire.close()


def test_only_the_host_by_its_certificates_name_gets_a_command_through(tmp_path):
    issue("ca", tmp_path)
    for name in ("robot", "adatracker-host", "visitor"):
        issue(name, tmp_path, "ca")

    def certified(name):
        root, pair = f"{tmp_path}/ca.pem", {"certificate": f"{name}.pem", "private_key": f"{name}.key"}
        return Tls(root_ca=root, **{key: f"{tmp_path}/{file}" for key, file in pair.items()})

    port = free_port()
    connection = rehearsed(endpoint=f"tls/127.0.0.1:{port}", tls=certified("adatracker-host")).connection
    with (
        zenoh.open(guarded(port, tmp_path)) as robot,
        open_session(replace(connection, tls=certified("visitor"))) as visitor,
        open_session(connection) as host,
    ):
        commands = latest(robot, "cmd_vel")
        got = []

        def passed():
            visitor.put("cmd_vel", b"from the visitor")
            host.put("cmd_vel", b"from the host")
            while (sample := commands.try_recv()) is not None:
                got.append(bytes(sample.payload))
            return len(got) >= 20

        until(passed)
        assert set(got) == {b"from the host"}


def test_nothing_else_gets_through(connection):
    with bridge(connection) as robot, open_session(connection) as stranger:
        forbidden, allowed = latest(robot, "cmd_vel_mux/estop"), latest(robot, "cmd_vel")
        secrets = latest(stranger, "rosout")
        stranger.put("cmd_vel_mux/estop", b"x")
        robot.put("rosout", b"x")

        def passed():
            stranger.put("cmd_vel", b"x")
            return allowed.try_recv() is not None

        until(passed)  # so did whatever was put before it
        assert forbidden.try_recv() is None
        assert secrets.try_recv() is None
