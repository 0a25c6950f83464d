"""Zenoh: all that the host hears, its camera's topic too, and the commands of the simulated robot."""

from __future__ import annotations

import contextlib
import itertools
import random

from flood import Result, lives, pour, until

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.platform import Scenario
from adatracker_deploy.registry import load_platform, load_profile


@contextlib.contextmanager
def quadruped():
    platform_class, clock = load_platform("quadruped"), MonotonicClock()
    profile = load_profile("go2", platform_class)
    with platform_class.sitl(profile) as sitl:
        reached = sitl.start(clock, Scenario(seed=1))
        with platform_class(reached, clock) as platform:
            platform.connect()
            platform.preflight()
            yield platform, sitl.pid


def flood_host(count: int) -> Result:
    """Flood all that the host listens to, its camera's topic too."""
    from adatracker_deploy.config.camera_topic import with_camera
    from adatracker_deploy.core.geometry import Pose
    from adatracker_deploy.core.messages import ZERO
    from adatracker_deploy.perception.compressed_image import CompressedImage
    from adatracker_quadruped.protocol import messages
    from adatracker_quadruped.protocol.keys import Keys

    with quadruped() as (platform, _):
        profile = platform.profile
        keys = Keys(with_camera(profile))
        image = CompressedImage(1, "jpeg", memoryview(b"\xff\xd8" + bytes(500)))
        good = {
            keys.odometry: messages.encode_odometry(messages.Odometry(Pose(), ZERO, 1)),
            keys.imu: messages.encode_imu(messages.Imu((0.0,) * 3, (0.0,) * 3, (0.0, 0.0, 9.8), 1)),
            keys.battery: messages.encode_battery(0.5),
            keys.camera: messages.encode_compressed_image(image),
        }
        with _camera(profile, platform.clock) as camera:
            seconds, grown_kb, orders = _publish(profile.connection, good, count, "self")
            dropped = camera.dropped + platform._wire.watch.dropped
            faults = [f"{orders} orders were sent"] if orders else []
            seen = camera.read(platform.clock.now_ns()).seq
            if not until(lambda: camera.read(platform.clock.now_ns()).seq > seen):
                faults.append("the camera shows nothing any more")
        return Result(seconds, grown_kb, f"{dropped:,} malformed", (*faults, *lives(platform)))


@contextlib.contextmanager
def _camera(profile, clock):
    """The robot's camera, open; on a busy machine its first picture takes longer than a trial would wait."""
    from adatracker_quadruped.adapter.camera import ZenohCamera

    for attempt in range(5):
        with contextlib.closing(ZenohCamera(profile, clock)) as camera:
            try:
                camera.open()
            except PlatformError:
                if attempt == 4:
                    raise
                continue
            yield camera
            return


def flood_robot(count: int) -> Result:
    """Flood the commands of the simulated robot."""
    from adatracker_deploy.core.messages import ZERO
    from adatracker_quadruped.protocol.keys import Keys
    from adatracker_quadruped.protocol.messages import encode_twist

    with quadruped() as (platform, pid):
        start = platform.state().pose
        good = {Keys(platform.profile.connection).command: encode_twist(ZERO)}
        seconds, grown_kb, _ = _publish(platform.profile.connection, good, count, pid)
        place = platform.state().pose
        moved = start.distance_to(place.x, place.y) > 1e-6
        return Result(seconds, grown_kb, "not told", (*(["it walked"] if moved else []), *lives(platform)))


def _publish(connection, good: dict[str, bytes], count: int, pid: int | str) -> tuple[float, int, int]:
    """Publish payloads on all the keys in turn; return seconds, kB grown, and the commands that were seen."""
    import zenoh

    from adatracker_quadruped.protocol.keys import Keys
    from adatracker_quadruped.protocol.session import open_session
    from adatracker_quadruped.sim.fuzz import payloads

    with open_session(connection) as session:
        block = zenoh.CongestionControl.BLOCK
        publishers = {key: session.declare_publisher(key, congestion_control=block) for key in good}
        until(lambda: all(publisher.matching_status.matching for publisher in publishers.values()))
        command = Keys(connection).command
        orders = (
            session.declare_subscriber(command, zenoh.handlers.RingChannel(8))
            if command not in good
            else None
        )
        for publisher in publishers.values():
            for _ in range(500):
                publisher.put(bytes(100_000))  # fills the receive buffers for fragments
        streams = [(publishers[key], payloads(good[key], random.Random(key))) for key in good]
        mixed = ((publisher, next(stream)) for publisher, stream in itertools.cycle(streams))
        seconds, grown_kb = pour(mixed, count, lambda pair: pair[0].put(pair[1]), lambda _: None, pid)
        seen = 0
        while orders is not None and orders.try_recv() is not None:
            seen += 1
        return seconds, grown_kb, seen
