"""The robot's camera over its wire: the newest image alone, paired with its truth, and its every end."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np
import pytest

from adatracker_deploy.config.camera_topic import with_camera
from adatracker_deploy.core.camera import OPEN_TIMEOUT_S
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import MaskClass, Truth
from adatracker_deploy.perception.compressed_image import CompressedImage
from adatracker_quadruped.adapter.camera import ZenohCamera
from adatracker_quadruped.platform import QuadrupedPlatform
from adatracker_quadruped.protocol.keys import Keys
from adatracker_quadruped.protocol.messages import encode_compressed_image
from adatracker_quadruped.protocol.publisher import Publisher
from adatracker_quadruped.protocol.rehearsal_keys import Fault, SitlKeys, encode_stamped_truth
from tests.quadruped.rehearsal import goes_wrong, rehearsed, simulator
from tests.quadruped.routers import free_port, robot, until
from tests.tiers import EXHAUSTIVE, sampled

pytestmark = pytest.mark.slow


def png(grey, size=(24, 32)):
    return cv2.imencode(".png", np.full((*size, 3), grey, np.uint8))[1].tobytes()


class Lens:
    """A robot whose images the test makes, behind a real router; each frame is grey by its number."""

    def __init__(self, session, connection):
        self._outlet = Publisher(session, Keys(connection).camera, attaches=Keys(connection).attaches)
        self._truths = Publisher(session, SitlKeys(connection).truth, attaches=False)
        self.shots = 0

    def put(self, payload):
        self._outlet.put(payload, time.time_ns())

    def shoot(self, stamp_ns=None):
        """Take the next picture: grey by its number, and so far away in its truth."""
        self.shots += 1
        truth = Truth(np.zeros((2, 2), np.uint8), Pose(), Pose(), (0.0, 0.0), float(self.shots), 0.0)
        stamp_ns = stamp_ns or time.time_ns()
        self._truths.put(encode_stamped_truth(stamp_ns, truth), 0)
        data = png(self.shots % 256)
        self.put(encode_compressed_image(CompressedImage(stamp_ns, "png", memoryview(data))))


@pytest.fixture(params=sampled(("ros2dds", "rmw_zenoh"), everyday=("rmw_zenoh",)))
def profile(request):
    return rehearsed(endpoint=f"tcp/127.0.0.1:{free_port()}", dialect=request.param, namespace="robot1")


@pytest.fixture
def lens(profile):
    connection = with_camera(profile)
    with robot(connection) as session:
        yield Lens(session, connection)


@pytest.fixture
def camera(profile, lens):
    camera = QuadrupedPlatform.camera(profile, MonotonicClock())
    assert isinstance(camera, ZenohCamera)
    opened(camera, lens)
    yield camera
    camera.close()


def opened(camera, lens):
    """Open a camera whose first image only comes once it listens."""
    opening = threading.Thread(target=camera.open)
    opening.start()
    until(lambda: lens.shoot() or not opening.is_alive())
    opening.join()
    caught_up(camera, lens)


def newest(camera):
    """Read, again if the only frame came after the time that was asked for."""
    return camera.read(camera.clock.now_ns()) or camera.read(camera.clock.now_ns())


def caught_up(camera, lens):
    """Wait for the last picture taken; one that the wire has dropped, as it may, is taken again."""
    asked_s = time.monotonic()

    def there():
        nonlocal asked_s
        if newest(camera).rgb[0, 0, 0] == lens.shots % 256:
            return True
        if time.monotonic() > asked_s + 0.5:
            asked_s = time.monotonic()
            lens.shoot()
        return False

    until(there)


def ends_after(camera, match):
    """Read at the camera's rate until it refuses; return the seconds that took."""
    begin = time.monotonic()
    refusals = []

    def refuses():
        try:
            newest(camera)
        except PlatformError as error:
            refusals.append(str(error))
        return refusals

    until(refuses, 5.0)
    assert match in refusals[0]
    return time.monotonic() - begin


def test_a_frame_is_the_newest_image_in_the_order_of_red_green_and_blue(camera, lens):
    for _ in range(20):
        lens.shoot()
    caught_up(camera, lens)
    frame = newest(camera)
    assert frame.rgb.shape == (24, 32, 3)
    assert frame.truth is None
    assert 0 <= camera.clock.now_ns() - frame.t_ns < 5e9


def test_a_frame_that_was_not_there_yet_is_not_given(camera, lens):
    before_ns, seen = camera.clock.now_ns(), newest(camera).seq
    lens.shoot()
    until(lambda: newest(camera).seq > seen)
    assert camera.read(before_ns).seq == seen


def test_malformed_oversized_and_repeated_images_are_dropped_and_counted(camera, lens):
    seen = newest(camera).seq
    rubbish = [
        b"",
        bytes(100),
        encode_compressed_image(CompressedImage(7, "jpeg", memoryview(b"\xff\xd8 no"))),
    ]
    for count, payload in enumerate(rubbish, start=1):
        lens.put(payload)
        until(lambda wanted=count: camera.dropped >= wanted)
    lens.put(bytes(9 << 20))  # too large even to be received, and in the way of what follows
    until(lambda: lens.shoot() or newest(camera).seq > seen)
    caught_up(camera, lens)
    stamp_ns = time.time_ns()
    lens.shoot(stamp_ns=stamp_ns)
    caught_up(camera, lens)
    seen, dropped = newest(camera).seq, camera.dropped
    lens.shoot(stamp_ns=stamp_ns)
    until(lambda: camera.dropped == dropped + 1)
    assert newest(camera).seq == seen


def test_an_image_of_another_size_ends_the_camera(camera, lens):
    lens.put(encode_compressed_image(CompressedImage(time.time_ns(), "png", memoryview(png(1, (48, 64))))))

    ends_after(camera, "size changed")


def test_a_camera_without_images_says_so_in_five_seconds(profile, lens):
    camera = ZenohCamera(profile, MonotonicClock())
    begin = time.monotonic()
    with pytest.raises(PlatformError, match="no picture came within 5 s"):
        camera.open()
    assert time.monotonic() - begin < OPEN_TIMEOUT_S + 1.0
    camera.close()


def test_nobody_at_the_endpoint_is_said_within_two_seconds(profile):
    camera = ZenohCamera(profile, MonotonicClock())
    begin = time.monotonic()
    with pytest.raises(PlatformError, match="no Zenoh router or bridge answers"):
        camera.open()
    assert time.monotonic() - begin < 2.5


def test_the_topic_after_robot_wins_over_the_connections(profile):
    def key(uri, topic):
        connection = replace(profile.connection, camera_topic=topic, namespace="", dialect="ros2dds")
        camera = replace(profile.camera, uri=uri)
        return Keys(with_camera(replace(profile, connection=connection, camera=camera))).camera

    assert key("robot://front/compressed", "rear/compressed") == "front/compressed"
    assert key("world://simple_room", "rear/compressed") == "rear/compressed"
    with pytest.raises(UsageError, match="name the topic"):
        key("world://simple_room", "")


# In a rehearsal


def test_of_a_real_robot_no_truth_is_believed(camera, lens):
    lens.shoot()
    caught_up(camera, lens)
    assert newest(camera).truth is None


@pytest.mark.parametrize("token", ["", "a1b2"], ids=["started by hand", "started by --sitl"])
def test_each_image_of_a_rehearsal_has_the_truth_of_its_own_stamp(profile, token):
    """Of one that was started by hand a liveliness token tells; of the other, the connection."""
    profile = replace(profile, connection=replace(profile.connection, rehearsal_token=token))
    connection = with_camera(profile)
    with robot(connection) as session:
        lens, camera = Lens(session, connection), ZenohCamera(profile, MonotonicClock())
        alive = None if token else session.liveliness().declare_token(SitlKeys(connection).alive)
        opened(camera, lens)
        for burst in (1, 1, 5, 1, 20, 3):
            before = newest(camera).seq
            for _ in range(burst):
                lens.shoot()

            def another_came(before=before):
                if newest(camera).seq == before:
                    lens.shoot()  # a burst may be dropped to the last, as the wire's congestion control says
                return newest(camera).seq > before

            until(another_came)
            frame = newest(camera)
            assert frame.truth.distance_m % 256 == frame.rgb[0, 0, 0]
        camera.close()
        if alive is not None:
            alive.undeclare()


@pytest.fixture
def rehearsal():
    with simulator() as (sitl, profile):
        camera = ZenohCamera(profile, MonotonicClock())
        camera.open()
        yield sitl, profile, camera
        camera.close()


def test_every_image_of_a_rehearsal_carries_its_own_truth(rehearsal):
    _, _, camera = rehearsal
    camera.go()
    places, seen = set(), set()
    while len(seen) < 40:
        until(lambda: newest(camera).seq not in seen)
        frame = newest(camera)
        seen.add(frame.seq)
        places.add(frame.truth.target_xy)
        assert (frame.truth.mask == MaskClass.TARGET).any()
        assert frame.rgb.shape[:2] == frame.truth.mask.shape
    assert camera.dropped < 4  # a busy machine may lose the truth of an image, and then the image goes too
    assert len(places) > 10


def test_the_people_stand_until_they_are_told_to_go(rehearsal):
    _, _, camera = rehearsal
    first = newest(camera)
    until(lambda: newest(camera).seq > first.seq + 10)
    assert newest(camera).truth.target_xy == first.truth.target_xy
    camera.go()
    until(lambda: newest(camera).truth.target_xy != first.truth.target_xy)


@EXHAUSTIVE
@pytest.mark.parametrize("fault", [Fault.FROZEN_CAMERA, Fault.SILENT])
def test_a_camera_that_shows_nothing_new_is_gone_after_two_seconds(rehearsal, fault):
    _, profile, camera = rehearsal
    goes_wrong(profile, fault)
    took_s = ends_after(camera, "no picture has come for 2.")
    print(f"{fault}: refused after {took_s:.2f} s")
    assert took_s < 2.5


def test_a_camera_whose_router_was_killed_is_gone_at_once(rehearsal):
    sitl, _, camera = rehearsal
    os.kill(sitl.pid, signal.SIGKILL)
    took_s = ends_after(camera, "nothing answers")
    print(f"router killed: camera refused after {took_s * 1e3:.0f} ms")
    assert took_s < 0.2


@EXHAUSTIVE
def test_a_camera_can_be_closed_while_it_opens(rehearsal):
    _, profile, _ = rehearsal

    def open_and_be_closed(camera):
        with contextlib.suppress(PlatformError):
            camera.open()

    with ThreadPoolExecutor(1) as pool:
        for delay_ms in range(0, 100, 5):
            camera = ZenohCamera(profile, MonotonicClock())
            opening = pool.submit(open_and_be_closed, camera)
            camera.clock.sleep_until(camera.clock.now_ns() + delay_ms * 1_000_000)  # any moment will do
            camera.close()
            camera.close()
            opening.result(6.0)


@EXHAUSTIVE
def test_a_camera_that_is_never_closed_lets_the_interpreter_end(rehearsal):
    _, profile, _ = rehearsal
    forgetful = (
        "from adatracker_deploy.core.clock import MonotonicClock\n"
        "from adatracker_quadruped.adapter.camera import ZenohCamera\n"
        "from tests.quadruped.rehearsal import rehearsed\n"
        f"camera = ZenohCamera(rehearsed(endpoint={profile.connection.endpoint!r}), MonotonicClock())\n"
        "camera.open()\n"
    )
    done = subprocess.run([sys.executable, "-c", forgetful], timeout=20, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
