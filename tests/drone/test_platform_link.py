"""The adapter's link against the simulated PX4: what is signed, and who is not listened to."""

import contextlib
import dataclasses
import functools
import itertools
import math
import os
import random
import socket
import threading
import time

import pytest
from packing import KEY, packer
from pymavlink.dialects.v20 import common as mavlink

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.ports import unused_port
from adatracker_deploy.platform import Scenario
from adatracker_deploy.registry import load_profile
from adatracker_drone.adapter.preflight import link_checks
from adatracker_drone.platform import DronePlatform
from adatracker_drone.protocol.packets import HEARD, split
from adatracker_drone.sim.fuzz import datagrams


def until(condition, within_s=10.0):
    pause, end_s = threading.Event(), time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < end_s, "waited in vain"
        pause.wait(0.005)


def key_file(folder, key=KEY):
    path = folder / f"{key[0]}.key"
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT, 0o600)
    os.write(descriptor, key)
    os.close(descriptor)
    return str(path)


@contextlib.contextmanager
def rehearsal(**connection):
    """A simulator of its own, and an adapter that is not connected yet."""
    shipped, clock = load_profile("px4_quad", DronePlatform), MonotonicClock()
    made = dataclasses.replace(shipped.connection, url="udpin://127.0.0.1:0", **connection)
    with DronePlatform.sitl(dataclasses.replace(shipped, connection=made)) as sitl:
        reached = sitl.start(clock, Scenario(seed=1))
        with DronePlatform(reached, clock) as platform:
            yield platform


def link_of(checks):
    (link,) = [check for check in checks if check.name == "link"]
    return link


@pytest.mark.slow
def test_both_ends_sign_and_the_preflight_passes(tmp_path):
    with rehearsal(signing_key=key_file(tmp_path)) as platform:
        platform.connect()
        checks = platform.preflight()  # parameters are asked for and answered, all of it signed
        assert [check for check in checks if check.blocking and not check.ok] == []
        assert link_of(checks).message == "signed"
        assert platform.notices() == ()


@pytest.mark.slow
def test_an_autopilot_with_another_key_is_not_heard_and_the_refusal_says_why(tmp_path):
    with rehearsal(signing_key=key_file(tmp_path), connect_timeout_s=2.0) as platform:
        other = dataclasses.replace(
            platform.profile.connection, signing_key=key_file(tmp_path, KEY[::-1]), connect_timeout_s=2.0
        )
        stranger = DronePlatform(dataclasses.replace(platform.profile, connection=other), platform.clock)
        with pytest.raises(PlatformError, match=r"no autopilot.*without a valid signature") as refusal:
            stranger.connect()
        assert "\n" not in str(refusal.value)


@pytest.mark.slow
def test_a_second_talker_with_the_autopilots_id_changes_nothing_and_is_told_of():
    with rehearsal() as platform:
        platform.connect()
        assert all(check.ok for check in platform.preflight())
        before = platform.state()
        impostor = packer()
        lies = (
            mavlink.MAVLink_heartbeat_message(2, 12, 0x81, 3 << 16, 4, 3),  # armed, flown by its pilot
            mavlink.MAVLink_extended_sys_state_message(0, 2),  # in the air
            mavlink.MAVLink_local_position_ned_message(0, 900.0, 900.0, -900.0, 9.0, 9.0, 9.0),
            mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 0, 0, 1, *[0] * 6),
        )
        port = int(platform.profile.connection.url.rpartition(":")[2])
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            for _ in range(500):
                for lie in lies:
                    out.sendto(lie.pack(impostor), ("127.0.0.1", port))
        told = []
        until(lambda: told.extend(platform.notices()) or told)
        heard_ns = platform.clock.now_ns()
        until(lambda: platform.state().t_ns > heard_ns)
        now = platform.state()
        assert (now.mode, now.landed, now.battery) == (before.mode, True, before.battery)
        assert math.hypot(now.pose.x, now.pose.y) < 1.0
        assert "ignored from an address that is not the autopilot's" in told[0]
        link = link_of(platform.preflight())
        assert not link.ok
        assert "somebody else sends" in link.message


def test_ten_thousand_hostile_datagrams_from_the_autopilots_own_address_print_nothing_and_move_nothing(capfd):
    shipped = load_profile("px4_quad", DronePlatform)
    port = unused_port(socket.SOCK_DGRAM)
    connection = dataclasses.replace(shipped.connection, url=f"udpin://127.0.0.1:{port}")
    autopilot = packer()
    heartbeat = bytes(mavlink.MAVLink_heartbeat_message(2, 12, 81, 4 << 16 | 3 << 24, 3, 3).pack(autopilot))
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mad,
        DronePlatform(dataclasses.replace(shipped, connection=connection), MonotonicClock()) as platform,
    ):
        mad.connect(("127.0.0.1", port))
        ended = threading.Event()

        def talk():
            while not ended.wait(0.05):
                with contextlib.suppress(ConnectionRefusedError):
                    mad.send(heartbeat)

        talking = threading.Thread(target=talk)
        talking.start()
        platform.connect()
        ended.set()
        talking.join()
        mad.setblocking(False)
        orders = []
        place = mavlink.MAVLink_local_position_ned_message(0, 0, 0, 0, 0, 0, 0).pack(autopilot)

        def heard_since(asked_ns):
            mad.send(place)
            return platform.state().t_ns > asked_ns

        for number, datagram in enumerate(itertools.islice(datagrams(HEARD, random.Random(1)), 10_000)):
            mad.send(datagram)
            if number % 100 == 0:
                until(functools.partial(heard_since, platform.clock.now_ns()))
                with contextlib.suppress(BlockingIOError):
                    while True:
                        orders += [each.message for each in split(mad.recv(2048))]
        state = platform.state()
        assert state.velocity is None or state.velocity.is_finite()
        assert not state.engaged
        assert orders
        assert 84 not in orders, "no set-point"
        assert platform.notices()
    printed = capfd.readouterr()
    assert "\x1b" not in printed.out + printed.err
    assert printed.out == ""


@pytest.mark.parametrize(
    ("url", "key", "ignored", "says"),
    [
        ("udpin://127.0.0.1:14540", "", "", "this machine's own"),
        ("serial:///dev/ttyACM0:921600", "", "", "a cable's"),
        ("udpin://192.168.1.5:14540", "drone.key", "", "signed"),
        ("udpin://0.0.0.0:14540", "drone.key", "", "open on every network"),
        ("udpin://0.0.0.0:14540", "", "", "not signed"),
        ("udpin://192.168.1.5:14540", "", "", "not signed"),
        ("tcpout://192.168.1.5:5760", "", "", "not signed"),
        ("udpin://127.0.0.1:14540", "", "ignored: 3 from an address", "3 from an address"),
    ],
)
def test_a_link_that_others_could_use_is_warned_of(url, key, ignored, says):
    (check,) = link_checks(url, key, ignored)
    assert says in check.message
    assert not check.blocking
    assert check.ok == (says in ("this machine's own", "a cable's", "signed"))
