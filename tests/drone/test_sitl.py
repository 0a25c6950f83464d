"""Programs that know nothing of this toolkit find a plausible PX4 at the far end of the wire."""

from __future__ import annotations

import dataclasses
import os
import socket
import subprocess
import sys
import time

import pytest
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.offboard import Offboard, VelocityBodyYawspeed
from mavsdk.plugins.telemetry import LandedState, Telemetry
from pymavlink import mavutil

from adatracker_deploy.errors import UsageError
from adatracker_deploy.profile import load_profile
from adatracker_deploy.runtime.clock import MonotonicClock
from adatracker_drone.platform import DronePlatform
from adatracker_drone.sitl import DroneSitl

pytestmark = pytest.mark.slow


def eventually(condition, what: str, timeout_s: float = 30.0):
    deadline_s = time.monotonic() + timeout_s
    while not (found := condition()):
        assert time.monotonic() < deadline_s, f"not within {timeout_s} s: {what}"
        os.sched_yield()
    return found


def profile(url: str = "udpin://127.0.0.1:0", **sitl):
    shipped = load_profile("px4_quad", DronePlatform)
    return dataclasses.replace(
        shipped,
        connection=dataclasses.replace(shipped.connection, url=url),
        sitl=dataclasses.replace(shipped.sitl, **sitl),
    )


def test_a_plain_mavsdk_script_arms_climbs_flies_offboard_and_lands():
    with DroneSitl(profile()) as far_end:
        url = far_end.start(MonotonicClock(), seed=1).connection.url
        mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
        try:
            mavsdk.add_any_connection(url)
            drone = mavsdk.first_autopilot(10.0)
            action, telemetry, offboard = Action(drone), Telemetry(drone), Offboard(drone)
            eventually(telemetry.health_all_ok, "healthy")
            action.arm()
            action.set_takeoff_altitude(2.0)
            action.takeoff()
            eventually(lambda: telemetry.position_velocity_ned().position.down_m < -1.5, "climbs")
            eventually(lambda: telemetry.flight_mode().name == "HOLD", "take-off ends in HOLD")
            offboard.set_velocity_body(VelocityBodyYawspeed(0.0, 0.0, 0.0, 0.0))
            offboard.start()
            eventually(lambda: telemetry.flight_mode().name == "OFFBOARD", "OFFBOARD")
            offboard.set_velocity_body(VelocityBodyYawspeed(1.0, 0.0, 0.0, 0.0))
            start = telemetry.position_velocity_ned().position
            eventually(
                lambda: abs(telemetry.position_velocity_ned().position.east_m - start.east_m) > 2.0, "flies"
            )
            action.land()
            eventually(lambda: telemetry.landed_state() == LandedState.ON_GROUND, "lands")
            eventually(lambda: not telemetry.armed(), "disarms")
        finally:
            mavsdk.destroy()


def test_a_ground_station_on_the_second_link_sees_it_and_reads_its_parameters():
    station = mavutil.mavlink_connection("udpin:127.0.0.1:0", source_system=255)
    port = station.port.getsockname()[1]
    with DroneSitl(profile(gcs=f"udpout:127.0.0.1:{port}")) as far_end:
        far_end.start(MonotonicClock(), seed=1)
        heartbeat = station.wait_heartbeat(timeout=10)
        assert (heartbeat.type, heartbeat.autopilot) == (2, 12)
        station.param_fetch_all()
        names = set()
        deadline_s = time.monotonic() + 10
        while "SYS_AUTOSTART" not in names and time.monotonic() < deadline_s:
            message = station.recv_match(type="PARAM_VALUE", blocking=True, timeout=1)
            if message:
                names.add(message.param_id)
                count = message.param_count
        assert len(names) == count
        assert station.flightmode == "LOITER"
    station.close()


def test_a_taken_port_is_named_and_nothing_starts():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        far_end = DroneSitl(profile(f"udpin://127.0.0.1:{port}"))
        with pytest.raises(UsageError, match=f"UDP port {port} is in use"):
            far_end.start(MonotonicClock(), seed=1)
        far_end.close()


def test_it_ends_with_its_lifeline_and_refuses_wrong_settings():
    command = [sys.executable, "-m", "adatracker_drone.sitl", "--lifeline", "--port", "9"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline().startswith('{"ready"')
        process.stdin.close()
        assert process.wait(10) == 0
    wrong = subprocess.run(
        [*command, "--settings", '{"wind_m_s": 99}'], capture_output=True, text=True, timeout=20, check=False
    )
    assert wrong.returncode == 2
    assert "wind_m_s: 99.0 is out of range" in wrong.stdout
