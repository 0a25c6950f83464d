"""The protocol, its addresses and its units, and what happens when the other end misbehaves."""

from __future__ import annotations

import contextlib
import json
import math
import socket
import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.sim.unreal.address import Address, parse_address
from adatracker_deploy.sim.unreal.settings import read_settings
from adatracker_deploy.sim.unreal.units import kept, numbers, to_location, to_pose, to_rotation
from adatracker_deploy.sim.unreal.wire import AT_ONCE, connect
from tests.unreal.server import Game, Server, pose_of

ANGLE = st.floats(-1.5, 1.5)


def test_commands_are_answered_in_order_however_many():
    with Server(Game([])) as server:
        client = connect("127.0.0.1", server.port)
        commands = ["vget /level/name", "vget /cameras"] * AT_ONCE
        assert client.ask(commands) == [b"simple_room", b"FusionCamSensor "] * AT_ONCE
        assert server.game.heard == commands


def test_an_error_is_raised_or_if_wanted_returned():
    with Server(Game([])) as server:
        client = connect("127.0.0.1", server.port)
        assert client.ask(["vget /object/nobody/location"], lenient=True) == [b"error Cannot find object"]
        with pytest.raises(PlatformError, match="'vget /object/nobody/location' with 'error Cannot find"):
            client.ask(["vget /object/nobody/location"])


def test_a_lost_connection_is_said():
    with Server(Game([])) as server:
        client = connect("127.0.0.1", server.port)
        server.cut()
        with pytest.raises(PlatformError, match="the connection is lost"):
            client.ask(["vget /level/name"])


def test_nobody_there_and_somebody_else_there_are_refused():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]

        def greet():
            with listener.accept()[0] as wire:
                wire.sendall(b"SSH-2.0-OpenSSH_9.6\r\n")
                with contextlib.suppress(ConnectionError):
                    wire.recv(1)

        thread = threading.Thread(target=greet)
        thread.start()
        with pytest.raises(UsageError, match="not UnrealCV's protocol; start the game first"):
            connect("127.0.0.1", port)
        thread.join()
    with pytest.raises(UsageError, match=f"no UnrealCV server at 127.0.0.1:{port}"):
        connect("127.0.0.1", port)


def test_on_linux_the_second_client_finds_the_unix_socket():
    with Server(Game([]), unix=True) as server:
        connect("127.0.0.1", server.port).close()
        for _ in range(1000):
            if server.path.exists():
                break
            threading.Event().wait(0.01)
        assert connect("127.0.0.1", server.port).ask(["vget /level/name"]) == [b"simple_room"]


def test_an_address_says_where_which_level_and_with_what():
    assert parse_address("unrealcv/10.0.0.7:9000/Greek_Island") == Address("10.0.0.7", 9000, "Greek_Island")
    assert parse_address("unrealcv/[::1]:9001/a?settings=/b/c.json&camera=3") == Address(
        "::1", 9001, "a", "/b/c.json", 3
    )


@pytest.mark.parametrize(
    "scene",
    [
        "unrealcv/",
        "unrealcv/host/level",
        "unrealcv/host:9000",
        "unrealcv/host:99999/level",
        "unrealcv/host:9000/two words",
        "unrealcv/host:9000/level?camera=x",
        "unrealcv/host:9000/level?colour=red",
    ],
)
def test_other_addresses_are_refused(scene):
    with pytest.raises(UsageError, match=r"expected unrealcv/HOST:PORT/LEVEL"):
        parse_address(scene)


def test_the_settings_are_unrealzoos_own(tmp_path):
    file = tmp_path / "map.json"
    player = {"name": ["BP_Character_9"], "class_name": ["other_C"], "cam_id": [4]}
    file.write_text(json.dumps({"agents": {"player": player}, "safe_start": [[1, 2, 3.5], [-4, 5, 6]]}))
    settings = read_settings(str(file))
    assert (settings.player, settings.class_name) == ("BP_Character_9", "other_C")
    assert settings.starts == ((1.0, 2.0, 3.5), (-4.0, 5.0, 6.0))


@pytest.mark.parametrize("text", ["{", "[]", "{}", '{"agents": {"player": {"name": []}}}'])
def test_other_settings_are_refused(tmp_path, text):
    (tmp_path / "map.json").write_text(text)
    with pytest.raises(UsageError, match="not UnrealZoo's setting file"):
        read_settings(str(tmp_path / "map.json"))
    with pytest.raises(UsageError, match="cannot be read"):
        read_settings(str(tmp_path / "none.json"))


def test_left_is_minus_y_up_is_plus_and_centimetres_count():
    assert to_location(Pose(1.0, 2.0, 3.0)) == (100.0, -200.0, 300.0)
    left, down, right_side_down = Pose(yaw=math.pi / 2), Pose(pitch=0.1), Pose(roll=0.2)
    assert to_rotation(left) == (0.0, -90.0, 0.0)
    assert to_rotation(down) == pytest.approx((-math.degrees(0.1), 0.0, 0.0))
    assert to_rotation(right_side_down) == pytest.approx((0.0, 0.0, math.degrees(0.2)))


@given(roll=ANGLE, pitch=ANGLE, yaw=st.floats(-3.0, 3.0), y=st.floats(-50, 50))
def test_the_engines_own_matrix_says_the_same(roll, pitch, yaw, y):
    pose = Pose(1.0, y, 2.0, roll, pitch, yaw)
    there = pose_of(to_location(pose), to_rotation(pose))
    np.testing.assert_allclose(there.rotation(), pose.rotation(), atol=1e-12)
    np.testing.assert_allclose(there.translation(), pose.translation(), atol=1e-12)
    back = to_pose(to_location(pose), to_rotation(pose))
    np.testing.assert_allclose(back.rotation(), pose.rotation(), atol=1e-12)


def test_what_the_engine_only_rounded_is_kept():
    assert kept((1.23456, 2.0, 3.0), (1.235, 2.0, 3.1)) == (1.23456, 2.0, 3.1)
    assert kept((0.0, 190.0, 0.0), (0.0, -170.0, 0.0), 360.0) == (0.0, 190.0, 0.0)


def test_numbers_have_no_exponent():
    assert numbers((1e-9, -123456.75, 0.0)) == "0.000000001000 -123456.750000000000 0.000000000000"
