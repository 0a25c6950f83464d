"""The simulator as a process: a stranger's script flies it, a ground station reads it, it ends in order."""

import contextlib
import dataclasses
import json
import math
import select
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action, ActionError
from mavsdk.plugins.offboard import Offboard, PositionNedYaw, VelocityBodyYawspeed
from mavsdk.plugins.param import Param
from mavsdk.plugins.telemetry import Telemetry
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mavlink

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.ports import unused_port
from adatracker_deploy.platform import Scenario
from adatracker_deploy.registry import load_profile
from adatracker_drone.platform import DronePlatform
from adatracker_drone.sim.parameters import PARAMETERS, Kind, from_wire
from adatracker_drone.sim.simulator import Wire
from adatracker_drone.sim.sitl import DroneSitl
from tests.tiers import EXHAUSTIVE


def until(condition, timeout_s=30.0):
    """Wait until a condition holds and return what it gave."""
    pause, end_s = threading.Event(), time.monotonic() + timeout_s
    while not (value := condition()):
        assert time.monotonic() < end_s, "waited in vain"
        pause.wait(0.02)
    return value


def bound_socket(port=0):
    listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    listener.bind(("127.0.0.1", port))
    return listener


def free_port():
    return unused_port(socket.SOCK_DGRAM)


def profile(url="udpin://127.0.0.1:0", **sitl):
    shipped = load_profile("px4_quad", DronePlatform)
    return dataclasses.replace(
        shipped,
        connection=dataclasses.replace(shipped.connection, url=url),
        sitl=dataclasses.replace(shipped.sitl, **sitl),
    )


def command_line(*args):
    return [sys.executable, "-m", "adatracker_drone.sim.sitl", *args]


# What is refused


def test_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "jsbsim" else object())
    with pytest.raises(UsageError, match=r"needs jsbsim: pip install 'adatracker-deploy\[sitl\]'"):
        DroneSitl(profile()).start(MonotonicClock(), Scenario())


def test_closing_what_was_never_started_is_fine():
    sitl = DroneSitl(profile())
    sitl.close()
    sitl.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    "sitl", [{"parameters": {"COM_OF_LOSST": 1.0}}, {"gcs": "udp:14550"}, {"gcs": "udpout:127.0.0.999:14550"}]
)
def test_settings_that_cannot_be_are_the_users_mistake(sitl):
    with pytest.raises(UsageError, match=r"COM_OF_LOSST|udpout:127\.0\.0\.1:14550"):
        DroneSitl(profile(**sitl)).start(MonotonicClock(), Scenario())


# Bytes


@settings(max_examples=100, deadline=None)
@given(
    st.lists(
        st.binary(max_size=300) | st.binary(max_size=60).map(lambda tail: b"\xfd\xff\x00" + tail), max_size=5
    )
)
def test_no_bytes_upset_a_link_nor_hide_the_message_that_follows(datagrams):
    ping = mavlink.MAVLink_ping_message(1, 2, 0, 0).pack(mavlink.MAVLink(None, srcSystem=255))
    with bound_socket() as peer:
        wire = Wire(peer.getsockname())
        with wire.socket:
            for datagram in [*datagrams, ping]:
                peer.sendto(datagram, wire.socket.getsockname())
            assert wire.receive()[-1].get_type() == "PING"


def test_a_link_hears_its_own_peer_only():
    ping = mavlink.MAVLink_ping_message(1, 2, 0, 0).pack(mavlink.MAVLink(None, srcSystem=255))
    with bound_socket() as peer, bound_socket() as stranger:
        wire = Wire(peer.getsockname())
        with wire.socket:
            stranger.sendto(ping, wire.socket.getsockname())
            assert wire.receive() == []
            peer.sendto(ping, wire.socket.getsockname())
            assert len(wire.receive()) == 1


# The process


@pytest.fixture
def simulator():
    """A started simulator on a free port, as a rehearsal starts it."""
    started = []

    def start(*, speed=1.0, seed=1, **sitl_settings):
        sitl = DroneSitl(profile(**sitl_settings))
        started.append(sitl)
        return sitl, sitl.start(MonotonicClock(speed=speed), Scenario(seed=seed)).connection.url

    yield start
    for sitl in started:
        sitl.close()


@EXHAUSTIVE
@pytest.mark.slow
def test_a_script_like_mavsdks_examples_flies_it(simulator):
    _, url = simulator()
    drone = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    try:
        drone.add_any_connection(url)
        system = drone.first_autopilot(10.0)
        assert system is not None
        action, offboard, telemetry = Action(system), Offboard(system), Telemetry(system)
        until(telemetry.health_all_ok)

        action.set_takeoff_altitude(2.0)
        until(lambda: armed(action), 5.0)
        action.takeoff()
        until(lambda: telemetry.position().relative_altitude_m > 1.8)
        until(lambda: telemetry.flight_mode().name == "HOLD")

        offboard.set_velocity_body(VelocityBodyYawspeed(0.0, 0.0, 0.0, 0.0))
        offboard.start()
        until(lambda: telemetry.flight_mode().name == "OFFBOARD", 5.0)
        offboard.set_velocity_body(VelocityBodyYawspeed(1.0, 0.0, 0.0, 30.0))
        until(lambda: telemetry.attitude_angular_velocity_body().yaw_rad_s > math.radians(25), 5.0)
        until(lambda: math.hypot(*ground_speed(telemetry)) > 0.85, 5.0)
        offboard.set_position_ned(PositionNedYaw(0.0, 0.0, -2.0, 0.0))
        until(lambda: math.dist(place(telemetry), (0.0, 0.0, -2.0)) < 0.4)
        offboard.stop()
        until(lambda: telemetry.flight_mode().name == "HOLD")

        action.land()
        until(lambda: not telemetry.armed())
        assert not telemetry.in_air()
        assert telemetry.landed_state().name == "ON_GROUND"
        assert 0.9 < telemetry.battery().remaining_percent / 100 <= 1.0
    finally:
        drone.destroy()


def armed(action):
    """Try to arm: a busy machine may have kept the vehicle from telling that its checks changed again."""
    with contextlib.suppress(ActionError):
        action.arm()
        return True
    return False


def ground_speed(telemetry):
    velocity = telemetry.position_velocity_ned().velocity
    return velocity.north_m_s, velocity.east_m_s


def place(telemetry):
    position = telemetry.position_velocity_ned().position
    return position.north_m, position.east_m, position.down_m


@pytest.mark.slow
def test_mavsdk_reads_and_writes_its_parameters(simulator):
    _, url = simulator()
    drone = Mavsdk(Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER))
    try:
        drone.add_any_connection(url)
        param = Param(drone.first_autopilot(10.0))
        assert param.get_param_float("COM_OF_LOSS_T") == pytest.approx(1.0)
        assert param.get_param_int("COM_OBL_RC_ACT") == 4
        param.set_param_int("COM_OBL_RC_ACT", 5)
        assert param.get_param_int("COM_OBL_RC_ACT") == 5
    finally:
        drone.destroy()


@pytest.mark.slow
def test_a_ground_station_on_the_second_link_sees_everything_and_reads_the_parameters(simulator):
    port = free_port()
    station = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=255, dialect="common")
    try:
        simulator(gcs=f"udpout:127.0.0.1:{port}")
        beat = station.recv_match(type="HEARTBEAT", blocking=True, timeout=10)
        assert (beat.autopilot, beat.type) == (mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_TYPE_QUADROTOR)
        assert station.flightmode == "LOITER"
        station.mav.param_request_list_send(1, 1)
        values = {}
        while len(values) < len(PARAMETERS):
            told = station.recv_match(type="PARAM_VALUE", blocking=True, timeout=10)
            assert told is not None, f"heard {len(values)} of {len(PARAMETERS)} parameters"
            values[told.param_id] = from_wire(Kind(told.param_type), told.param_value)
        assert values["COM_OF_LOSS_T"] == pytest.approx(1.0)
        assert values["COM_OBL_RC_ACT"] == 4
        station.mav.command_long_send(1, 1, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, 148, 0, 0, 0, 0, 0, 0)
        assert station.recv_match(type="AUTOPILOT_VERSION", blocking=True, timeout=10) is not None
        assert station.recv_match(type="LOCAL_POSITION_NED", blocking=True, timeout=10) is not None
    finally:
        station.close()


def received(listener, kind, timeout_s=10.0):
    """Return the next message of a kind that arrives, and its sender's address."""
    link = mavlink.MAVLink(None)
    link.robust_parsing = True
    end_s = time.monotonic() + timeout_s
    while time.monotonic() < end_s:
        if select.select([listener], [], [], 0.5)[0]:
            data, sender = listener.recvfrom(2048)
            for message in link.parse_buffer(data) or []:
                if message.get_type() == kind:
                    return message, sender
    raise AssertionError(f"no {kind} within {timeout_s} s")


@pytest.mark.slow
@pytest.mark.parametrize("speed", [1.0, 5.0])
def test_its_time_runs_as_fast_as_the_shared_clock(simulator, speed):
    port = free_port()
    with bound_socket(port) as listener:
        simulator(speed=speed, gcs=f"udpout:127.0.0.1:{port}")
        first, _ = received(listener, "ATTITUDE")
        begin_s = time.monotonic()
        while received(listener, "ATTITUDE")[0].time_boot_ms - first.time_boot_ms < 2000 * speed:
            pass
        assert time.monotonic() - begin_s == pytest.approx(2.0, abs=0.3)


@pytest.mark.slow
def test_it_ends_with_its_lifeline_when_it_never_flew(simulator):
    sitl, _ = simulator()
    begin_s = time.monotonic()
    sitl.close()
    assert time.monotonic() - begin_s < 2.0


@pytest.mark.slow
def test_in_the_air_it_outlives_its_lifeline_until_it_has_landed():
    with bound_socket() as pilot:
        port = pilot.getsockname()[1]
        process = subprocess.Popen(
            command_line("--lifeline", "--speed", "5", "--port", str(port)),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            assert json.loads(process.stdout.readline())["ready"]["port"] == port
            _, vehicle = received(pilot, "HEARTBEAT")
            link = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)

            def order(command, *params):
                filled = [*params, *[0.0] * (7 - len(params))]
                pilot.sendto(link.command_long_encode(1, 1, command, 0, *filled).pack(link), vehicle)

            def in_state(state):
                return received(pilot, "EXTENDED_SYS_STATE")[0].landed_state == state

            until(lambda: received(pilot, "SYS_STATUS")[0].onboard_control_sensors_health & 0x10000000)
            order(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
            order(mavlink.MAV_CMD_NAV_TAKEOFF)
            until(lambda: in_state(mavlink.MAV_LANDED_STATE_IN_AIR))
            process.stdin.close()
            for _ in range(5):
                assert received(pilot, "ATTITUDE")
            assert process.poll() is None
            order(mavlink.MAV_CMD_NAV_LAND)
            assert process.wait(20) == 0
        finally:
            process.kill()
            process.wait()
            process.stdout.close()


@pytest.mark.slow
def test_a_flood_of_rubbish_changes_nothing():
    with bound_socket() as peer:
        process = subprocess.Popen(
            command_line("--lifeline", "--port", str(peer.getsockname()[1])),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            process.stdout.readline()
            _, vehicle = received(peer, "HEARTBEAT")
            before_kb = memory_kb(process.pid)
            rubbish = [bytes((n * 7 + k * 13) % 256 for k in range(n % 280)) for n in range(1000)]
            for datagram in rubbish * 20:
                peer.sendto(b"\xfd" + datagram, vehicle)
            beat, _ = received(peer, "HEARTBEAT")
            assert not beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
            assert memory_kb(process.pid) - before_kb < 20_000
        finally:
            process.kill()
            process.wait()
            process.stdin.close()
            process.stdout.close()


def memory_kb(pid):
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS"))


@pytest.mark.slow
def test_wrong_arguments_end_it_with_status_2_and_a_line():
    done = subprocess.run(
        command_line("--settings", '{"wind_m_s": 99}'),
        capture_output=True,
        text=True,
        check=False,
        timeout=30,
    )
    assert done.returncode == 2
    assert "wind_m_s: 99.0 is out of range" in done.stdout
