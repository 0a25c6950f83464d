"""Latency of a command, and of a picture, over each ground robot's wire, and its cost.

The adapters drive the simulators of ``--sitl``, in processes of their own; a bystander on the same
bus or router notes when each command comes by. Pictures go through the quadruped's camera.

python benchmarks/wires.py [--seconds 10]
"""

from __future__ import annotations

import argparse
import contextlib
import socket
import struct
import threading
import time
from dataclasses import replace

import cv2
import numpy as np
import zenoh

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.platform import Scenario
from adatracker_deploy.registry import load_platform, load_profile
from adatracker_quadruped.protocol.keys import Keys
from adatracker_quadruped.protocol.messages import CompressedImage, encode_compressed_image
from adatracker_quadruped.protocol.session import zenoh_config

RATE_HZ = 50.0
PERIOD_NS = round(1e9 / RATE_HZ)
STEPS = 400
"""Commands are told apart by their speed: a whole number of mm/s up to this."""


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--seconds", type=float, default=10.0)
    seconds = arguments.parse_args().seconds
    drive("wheeled", listen_to_can, seconds)
    drive("quadruped", listen_to_zenoh, seconds)
    for width, height in ((160, 160), (640, 480)):
        watch_pictures(width, height, seconds)


def drive(name: str, bystander, seconds: float) -> None:
    """Send commands at 50 Hz; print how long until a bystander has each, and what that costs."""
    platform_class, clock = load_platform(name), MonotonicClock()
    profile = load_profile(platform_class.default_profile, platform_class)
    with platform_class.sitl(profile) as sitl:
        reached = sitl.start(clock, Scenario(seed=1))
        with contextlib.closing(platform_class(reached, clock)) as platform, bystander(reached) as heard:
            platform.connect()
            platform.preflight()
            platform.engage()
            sent, calls_us = {}, []
            begun_s, cpu_s = time.monotonic(), time.process_time()
            for number in range(round(seconds * RATE_HZ)):
                clock.sleep_until(clock.now_ns() + PERIOD_NS)
                step = number % STEPS + 1
                now_ns = time.monotonic_ns()
                sent[number] = now_ns
                platform.send(Twist(vx=step / 1000), clock.now_ns())
                calls_us.append((time.monotonic_ns() - now_ns) / 1e3)
            took_s = time.monotonic() - begun_s
            share = (time.process_time() - cpu_s) / took_s
            platform.disengage()
        latencies_us = match(sent, heard)
    print(f"{name}: {len(latencies_us)} of {len(sent)} commands seen; CPU {share:.1%} of a core")
    show("send() itself", calls_us)
    show("command on the wire", latencies_us)


def match(sent: dict[int, int], heard: list[tuple[int, int]]) -> list[float]:
    """Return the us from each sending to the first sight of its speed, within half a second."""
    latencies_us = []
    at = 0
    for number, t_ns in sorted(sent.items()):
        for index in range(at, len(heard)):
            step, seen_ns = heard[index]
            if seen_ns - t_ns > 500_000_000:
                break
            if step == number % STEPS + 1 and seen_ns >= t_ns:
                latencies_us.append((seen_ns - t_ns) / 1e3)
                at = index
                break
    return latencies_us


@contextlib.contextmanager
def listen_to_can(profile):
    heard: list[tuple[int, int]] = []
    bus = socket.create_connection((profile.connection.host, profile.connection.port))
    bus.sendall(b"< open can0 >< rawmode >")

    def listen() -> None:
        rest = ""
        while data := bus.recv(65536):
            seen_ns = time.monotonic_ns()
            *lines, rest = (rest + data.decode()).split(">")
            frames = (line.split() for line in lines)
            commands = ("".join(words[4:]) for words in frames if words[1:3] == ["frame", "111"])
            heard.extend((*struct.unpack_from(">h", bytes.fromhex(data)), seen_ns) for data in commands)

    thread = threading.Thread(target=listen)
    thread.start()
    yield heard
    bus.shutdown(socket.SHUT_RDWR)
    thread.join()
    bus.close()


@contextlib.contextmanager
def listen_to_zenoh(profile):
    heard: list[tuple[int, int]] = []
    with zenoh.open(zenoh_config(profile.connection)) as session:
        commands = session.declare_subscriber(
            Keys(profile.connection).command, zenoh.handlers.FifoChannel(64)
        )

        def listen() -> None:
            with contextlib.suppress(zenoh.ZError):
                while True:
                    payload = commands.recv().payload.to_bytes()
                    (vx,) = struct.unpack_from("<d", payload, 4)
                    heard.append((round(vx * 1000), time.monotonic_ns()))

        thread = threading.Thread(target=listen)
        thread.start()
        yield heard
    thread.join()


def watch_pictures(width: int, height: int, seconds: float) -> None:
    """Publish JPEGs at 30 Hz; print when they arrive and when they can be read as RGB."""
    platform_class, clock = load_platform("quadruped"), MonotonicClock()
    profile = load_profile(platform_class.default_profile, platform_class)
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    profile = replace(profile, connection=replace(profile.connection, endpoint=f"tcp/127.0.0.1:{port}"))
    rng = np.random.default_rng(1)
    scene = cv2.resize(rng.integers(0, 255, (height // 8, width // 8, 3), np.uint8), (width, height))
    key = profile.camera.uri.removeprefix("robot://")
    arrived_us, read_us, sizes = [], [], []
    with zenoh.open(zenoh_config(profile.connection, mode="router")) as robot:
        camera = platform_class.camera(profile, clock)
        images = robot.declare_publisher(key)
        ended = threading.Event()

        def publish(number: int) -> int:
            scene[: height // 8] = number % 256  # a camera that repeats itself counts as frozen
            jpeg = cv2.imencode(".jpg", scene)[1].tobytes()
            stamp_ns = time.time_ns()
            image = CompressedImage(stamp_ns=stamp_ns, format="jpeg", data=jpeg)
            payload = encode_compressed_image(image)
            sizes.append(len(payload))
            put_ns = clock.now_ns()
            images.put(payload)
            return put_ns

        def warm_up() -> None:
            number = 0
            while not ended.wait(1 / 30):
                number += 1
                publish(number)

        warming = threading.Thread(target=warm_up)
        warming.start()
        with contextlib.closing(camera):
            camera.open()
            ended.set()
            warming.join()
            cpu_s, begun_s = time.process_time(), time.monotonic()
            for number in range(round(seconds * 30)):
                clock.sleep_until(clock.now_ns() + 33_000_000)
                before = camera.read(clock.now_ns())
                put_ns = publish(number)
                deadline_ns = put_ns + 500_000_000
                while clock.now_ns() < deadline_ns:
                    frame = camera.read(clock.now_ns())
                    if frame.seq != before.seq:
                        arrived_us.append((frame.t_ns - put_ns) / 1e3)
                        read_us.append((clock.now_ns() - put_ns) / 1e3)
                        break
                    time.sleep(1e-4)
            share = (time.process_time() - cpu_s) / (time.monotonic() - begun_s)
    print(
        f"quadruped's camera {width}x{height}, {np.median(sizes) / 1e3:.0f} kB: {len(read_us)} pictures, "
        f"CPU of both sides {share:.0%} of a core"
    )
    show("arrival", arrived_us)
    show("readable as RGB", read_us)


def show(what: str, values_us) -> None:
    p50, p99 = np.percentile(values_us, (50, 99))
    print(f"  {what:20s} p50 {p50:7.0f} us   p99 {p99:7.0f} us   max {max(values_us):7.0f} us")


if __name__ == "__main__":
    main()
