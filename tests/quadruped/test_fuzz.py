"""A hundred thousand hostile payloads on each inbound key: no crash, no motion, no memory."""

import os
import random

import pytest
import zenoh

from adatracker_deploy.config.camera_topic import with_camera
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import ZERO
from adatracker_deploy.perception.compressed_image import CompressedImage
from adatracker_quadruped.adapter.camera import ZenohCamera
from adatracker_quadruped.protocol.keys import Keys
from adatracker_quadruped.protocol.messages import (
    Imu,
    Odometry,
    encode_battery,
    encode_compressed_image,
    encode_imu,
    encode_odometry,
    encode_twist,
)
from adatracker_quadruped.protocol.rehearsal_keys import SitlKeys
from adatracker_quadruped.protocol.session import open_session
from adatracker_quadruped.sim.fuzz import payloads
from tests.driving import engages
from tests.quadruped.rehearsal import connected, memory_kb, moved, simulator
from tests.quadruped.routers import until
from tests.tiers import sampled

pytestmark = pytest.mark.slow

PAYLOADS = 100_000
LARGEST_GROWTH_KB = 32_000
GOOD = {
    "odometry": encode_odometry(Odometry(Pose(), ZERO, 1)),
    "imu": encode_imu(Imu((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 9.8), 1)),
    "battery": encode_battery(0.5),
    "camera": encode_compressed_image(CompressedImage(1, "jpeg", memoryview(b"\xff\xd8" + bytes(500)))),
    "command": encode_twist(ZERO),
}


def flood(session, key, good, pid):
    """Put them all on one key as fast as the link takes them; return by how many kB a process has grown.

    Zenoh keeps 20 MB of receive buffers for each session that has ever sent it a message in fragments; they
    are filled before the count begins.
    """
    publisher = session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
    until(lambda: publisher.matching_status.matching)
    for _ in range(500):
        publisher.put(bytes(100_000))
    before_kb = memory_kb(pid)
    rubbish = payloads(good, random.Random(key))
    for _ in range(PAYLOADS):
        publisher.put(next(rubbish))
    grew_kb = memory_kb(pid) - before_kb
    print(f"{key}: {PAYLOADS} payloads, {grew_kb} kB more")
    return grew_kb


@pytest.mark.parametrize("inbound", sampled(("command", "fault", "go"), everyday=("command",)))
def test_the_robot_does_not_move_for_hostile_commands(inbound):
    with simulator() as (sitl, profile), connected(profile) as platform:
        keys, sitl_keys = Keys(profile.connection), SitlKeys(profile.connection)
        key = {"command": keys.command, "fault": sitl_keys.fault, "go": sitl_keys.go}[inbound]
        start = platform.state().pose
        with open_session(profile.connection) as session:
            assert flood(session, key, GOOD.get(inbound, b"low_battery!"), sitl.pid) < LARGEST_GROWTH_KB
        assert moved(platform, start, 0.5) < 1e-6
        platform.engage()
        platform.send(ZERO, platform.clock.now_ns())


@pytest.mark.parametrize("inbound", sampled(("odometry", "imu", "battery"), everyday=("battery",)))
def test_the_host_lives_through_hostile_messages_from_the_robots_side(inbound):
    with simulator() as (_, profile), connected(profile) as platform:
        key = getattr(Keys(profile.connection), inbound)
        with open_session(profile.connection) as session:
            assert flood(session, key, GOOD[inbound], os.getpid()) < LARGEST_GROWTH_KB
        (notice,) = platform.notices()
        assert "malformed messages were dropped" in notice
        assert platform.notices() == ()
        state = platform.state()
        assert state.velocity.is_finite()
        assert state.battery is None or 0.0 <= state.battery <= 1.0
        until(lambda: platform.state().age_s(platform.clock.now_ns()) < 0.1)
        until(lambda: engages(platform))  # stamps that went back are not trusted for a second
        platform.send(ZERO, platform.clock.now_ns())
        assert not platform.state().stopped


def test_the_camera_shows_nothing_hostile():
    with simulator() as (_, profile):
        camera = ZenohCamera(profile, MonotonicClock())
        camera.open()
        try:
            with open_session(profile.connection) as session:
                key = Keys(with_camera(profile)).camera
                assert flood(session, key, GOOD["camera"], os.getpid()) < LARGEST_GROWTH_KB
            assert camera.dropped > 0
            seen = camera.read(camera.clock.now_ns()).seq
            until(lambda: camera.read(camera.clock.now_ns()).seq > seen)
            assert camera.read(camera.clock.now_ns()).truth is not None
        finally:
            camera.close()
