"""The node that a bare Go2 lacks, between a real host and a sport service over real DDS."""

import contextlib
import dataclasses
import shlex
import signal
from pathlib import Path

import pytest

from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_quadruped.protocol.keys import Keys
from adatracker_quadruped.protocol.messages import encode_twist
from adatracker_quadruped.protocol.session import open_session
from adatracker_quadruped.robot.walker import STOPS, Walker
from tests.tiers import EXHAUSTIVE

pytest.importorskip("cyclonedds", reason="the extra go2 is not installed")

from adatracker_quadruped.robot import node as node_module
from tests.driving import send_for
from tests.quadruped.bare_go2 import CHARGE, PLACE, WALK, BareGo2, node
from tests.quadruped.rehearsal import connected, rehearsed
from tests.quadruped.routers import free_port, publisher_of, until

AHEAD = Twist(vx=0.4, yaw_rate=0.2)

# What it decides


def test_it_is_silent_until_a_host_commands_it():
    walker = Walker(0.5)
    assert [walker.step(0.1 * tick, None, host_left=tick == 3) for tick in range(20)] == [None] * 20


def test_a_command_is_passed_on_and_its_end_is_a_stop_said_three_times():
    walker = Walker(0.5)
    assert walker.step(10.0, AHEAD, host_left=False) == AHEAD
    said = [walker.step(10.0 + 0.02 * tick, None, host_left=False) for tick in range(1, 60)]
    assert said.index("stop") == 25  # the first turn later than 0.5 s
    assert said.count("stop") == STOPS
    assert not walker.walks
    assert walker.step(20.0, AHEAD, host_left=False) == AHEAD


def test_a_host_that_leaves_stops_it_at_once_even_with_a_last_command():
    walker = Walker(0.5)
    walker.step(10.0, AHEAD, host_left=False)
    assert walker.step(10.02, AHEAD, host_left=True) == "stop"
    assert [walker.step(10.1, None, host_left=False) for _ in range(3)] == ["stop", "stop", None]


# Between a host and a Go2


@pytest.fixture
def go2():
    with contextlib.closing(BareGo2()) as go2:
        yield go2


def walks(go2, commands):
    """Command it until it walks."""
    until(lambda: commands.matching_status.matching)

    def walked():
        commands.put(encode_twist(AHEAD))
        return AHEAD in go2.moves

    until(walked)


@pytest.mark.slow
def test_a_bare_go2_is_walked_and_heard_by_the_shipped_profile(go2):
    port = free_port()
    profile = rehearsed(endpoint=f"tcp/127.0.0.1:{port}")
    with node(go2, port), connected(profile) as platform:
        assert go2.asked == []
        platform.engage()
        send_for(platform, AHEAD, 0.5)
        state = platform.state()
        assert (state.pose.x, state.pose.y, state.pose.z) == pytest.approx((1.5, -0.5, 0.3))
        assert state.pose.yaw == pytest.approx(PLACE.yaw, abs=1e-6)
        assert dataclasses.astuple(state.velocity) == pytest.approx(dataclasses.astuple(WALK), abs=1e-6)
        assert state.battery == pytest.approx(CHARGE)
        platform.hold("enough")
        until(lambda: len(go2.stops) == STOPS)
        assert [request.twist for _, request in go2.asked[-STOPS - 1 :]] == [ZERO] + [None] * STOPS
    assert go2.moves.count(AHEAD) >= 10


@EXHAUSTIVE
@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [
        {"odometry": "sport_mode_state", "battery": "low_state", "imu_topic": ""},
        {"command": "unitree_sport", "command_topic": "api/sport/request"},
    ],
    ids=["its own telemetry", "its own requests"],
)
def test_unitrees_own_messages_pass_through(go2, tmp_path, changes):
    port = free_port()
    shipped = node_module.load_profile("go2")
    text = Path("calib-free-profiles/go2.yaml").read_text(encoding="utf-8")
    for name, value in changes.items():
        old = getattr(shipped.connection, name)
        if f"  {name}: {old}" in text:
            text = text.replace(f"  {name}: {old}", f"  {name}: {value or chr(34) * 2}", 1)
        else:
            text = text.replace("connection:\n", f"connection:\n  {name}: {value}\n", 1)
    (tmp_path / "mine.yaml").write_text(text, encoding="utf-8")
    profile = rehearsed(endpoint=f"tcp/127.0.0.1:{port}", **changes)
    with node(go2, port, "--profile", str(tmp_path / "mine.yaml")), connected(profile) as platform:
        platform.engage()
        send_for(platform, AHEAD, 0.3)
        assert platform.state().pose.x == pytest.approx(PLACE.x)
        assert platform.state().battery == pytest.approx(CHARGE)
        platform.hold("enough")
        until(lambda: len(go2.stops) >= STOPS)
    assert go2.moves.count(AHEAD) >= 5


@pytest.mark.slow
def test_a_host_that_dies_stops_the_robot_before_the_time_out_does(go2):
    port = free_port()
    connection = rehearsed(endpoint=f"tcp/127.0.0.1:{port}").connection
    with node(go2, port):
        with open_session(connection) as session:
            token = session.liveliness().declare_token(connection.host_token)
            commands = publisher_of(session, Keys(connection).command)
            walks(go2, commands)
            assert token is not None
        until(lambda: len(go2.stops) == STOPS)
        last_s = max(at_s for at_s, request in go2.asked if request.twist is not None)
        assert go2.stops[0] - last_s < connection.command_timeout_s / 2


@pytest.mark.slow
def test_a_node_that_is_ended_stops_a_robot_that_walks(go2):
    port = free_port()
    connection = rehearsed(endpoint=f"tcp/127.0.0.1:{port}").connection
    with node(go2, port) as process, open_session(connection) as session:
        commands = publisher_of(session, Keys(connection).command)
        walks(go2, commands)
        process.send_signal(signal.SIGTERM)
        assert process.wait(10) == 0
    until(lambda: len(go2.stops) >= STOPS)


# How it is started


def test_without_an_interface_it_would_speak_everywhere_and_is_refused(monkeypatch, capsys):
    monkeypatch.delenv("CYCLONEDDS_URI", raising=False)
    assert node_module.main([]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "--interface is missing" in line


@pytest.mark.parametrize("interface", ['x"/>', "a" * 16])
def test_what_is_no_interface_is_refused(capsys, interface):
    assert node_module.main(["--interface", interface]) == 2
    assert "is not a network interface" in capsys.readouterr().err


def test_the_unit_file_starts_the_node_with_arguments_that_it_has():
    unit = Path(node_module.__file__).with_name("adatracker-go2.service").read_text(encoding="utf-8")
    (command,) = [line.partition("=")[2] for line in unit.splitlines() if line.startswith("ExecStart=")]
    python, flag, module, *arguments = shlex.split(command)
    assert (Path(python).name, flag, module) == ("python", "-m", "adatracker_quadruped.robot")
    args = node_module._arguments().parse_args(arguments)
    shipped = node_module.load_profile(args.profile)
    assert (args.interface, args.listen) == ("eth0", shipped.connection.endpoint)
