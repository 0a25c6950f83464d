"""Latency of a camera over HTTP: from a published frame to its picture in the reader's hands, and the CPU.

python benchmarks/camera.py [--seconds 10] [--rate 30]

The simulator's server and the reader share one process here, so CPU is of both: encoding, wire and decoding.
The picture is smooth noise, about as hard to compress as a rendered room.
"""

from __future__ import annotations

import argparse
import threading
import time

import cv2
import numpy as np

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Frame, Truth
from adatracker_deploy.perception.mjpeg import MjpegCamera
from adatracker_deploy.perception.mjpeg_server import MjpegServer
from adatracker_deploy.runtime.pacer import Pacer

SIZES = ((160, 160), (640, 480))
PICTURES = 16
"""Different ones; the grey of a corner says which one it is, so that a skipped frame is not mistaken."""
CORNER_PX = 16
WARM_UP_FRAMES = 10


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="for each line")
    parser.add_argument("--rate", type=float, default=30.0, help="frames per second")
    arguments = parser.parse_args()
    print(f"{arguments.rate:g} frames per second     publish to read, ms     frames   CPU of")
    print("                           p50     p99     max     seen   a core")
    for size in SIZES:
        for with_truth in (False, True):
            frames = make_frames(size, with_truth=with_truth)
            latencies_ms, seen, cpu = measure(frames, arguments.seconds, arguments.rate)
            p50, p99 = np.percentile(latencies_ms, (50, 99))
            name = f"{size[0]}x{size[1]}{', with truth' if with_truth else ''}"
            print(f"{name:22}{p50:8.2f}{p99:8.2f}{max(latencies_ms):8.2f}{seen:9.1%}{cpu:9.1%}", flush=True)


def make_frames(size, *, with_truth) -> list[Frame]:
    width, height = size
    rng = np.random.default_rng(0)
    mask = cv2.resize(rng.integers(0, 4, (12, 12), np.uint8), size, interpolation=cv2.INTER_NEAREST)
    truth = Truth(mask, Pose(), Pose(), (1.0, 0.0), 1.0, 0.0) if with_truth else None
    frames = []
    for number in range(PICTURES):
        coarse = rng.integers(0, 256, (height // 10, width // 10, 3), np.uint8)
        rgb = cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC)
        rgb[:CORNER_PX, :CORNER_PX] = number * (256 // PICTURES)
        frames.append(Frame(rgb, 0, number, truth))
    return frames


def number_of(rgb) -> int:
    return round(float(rgb[: CORNER_PX // 2, : CORNER_PX // 2].mean()) / (256 // PICTURES))


def measure(frames, seconds, rate_hz) -> tuple[list[float], float, float]:
    """Return the latencies in ms, the share of the frames that were seen, and of a core that was used."""
    clock, server = MonotonicClock(), MjpegServer()
    published_ns: list[int] = []

    def publish() -> None:
        published_ns.append(clock.now_ns())
        server.publish(frames[(len(published_ns) - 1) % PICTURES])

    def film() -> None:
        pacer = Pacer(clock, rate_hz)
        while not ended.is_set():
            pacer.wait()
            publish()

    publish()
    camera = MjpegCamera(server.url, clock)
    camera.open()
    ended, latencies_ms, last = threading.Event(), [], camera.read(clock.now_ns())
    thread = threading.Thread(target=film)
    thread.start()
    began_s, began_cpu_s = time.perf_counter(), time.process_time()
    while time.perf_counter() - began_s < seconds:
        frame = camera.read(clock.now_ns())
        if frame is not last:
            seen_ns, newest, last = clock.now_ns(), len(published_ns) - 1, frame
            behind = (newest - number_of(frame.rgb)) % PICTURES
            latencies_ms.append((seen_ns - published_ns[newest - behind]) / 1e6)
        time.sleep(0.0002)
    cpu = (time.process_time() - began_cpu_s) / (time.perf_counter() - began_s)
    seen = len(latencies_ms) / (len(published_ns) - 1)
    ended.set()
    thread.join()
    camera.close()
    server.close()
    return latencies_ms[WARM_UP_FRAMES:], seen, cpu


if __name__ == "__main__":
    main()
