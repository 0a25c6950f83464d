"""Times each stage on a robot's computer: one command, one table to send back.

python benchmarks/board.py [--provider cpu] [--provider cuda] [--film CLIP] [--seconds 10]

* decode: a JPEG of 640x480, as USB and network cameras send them.
* perceive: the embedded segmenter, from a decoded picture of 640x480 to the observation. Pictures are noise,
  in which nobody is found, unless `--film` gives a clip; people in it cost more (docs/segmenters.md).
* infer: a tick of the shipped policy.
* gate: a slot of the link with a robot without a wire behind it: the gate, the status, the command.
* log: a second of a trial, written and synced.
* lateness: how late the loop's ticks begin, ordinary, and with `--realtime` where the system allows it.

perceive and infer are timed once for each provider, warm; lateness is with the policy on the processor. Leave
the machine alone meanwhile. Status 2 where a provider is not to be had.
"""

from __future__ import annotations

import argparse
import itertools
import os
import platform
import time
from pathlib import Path

import cv2
import numpy as np
import onnxruntime

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import Frame, Twist
from adatracker_deploy.core.onnx_session import PROVIDERS
from adatracker_deploy.doctor import timing
from adatracker_deploy.perception.segmenters import EMBEDDED, open_segmenter
from adatracker_deploy.perception.target.choice import Choice
from adatracker_deploy.policy.catalogue import DEFAULT, load_policy
from adatracker_deploy.runtime.gate import Setpoint
from adatracker_deploy.runtime.link import RATE_HZ, Link, Phase
from adatracker_deploy.runtime.scheduling import Scheduling
from adatracker_deploy.testing.fake import FakePlatform, fake_profile

TIMES = 200
SIZE = 640, 480


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--provider", action="append", choices=PROVIDERS, help="(default: cpu)")
    parser.add_argument("--film", type=Path, help="perceive these pictures, scaled to 640x480")
    parser.add_argument("--seconds", type=float, default=10.0, help="how long each loop is timed")
    arguments = parser.parse_args()
    try:
        show(arguments)
    except UsageError as error:
        parser.error(str(error))


def show(arguments: argparse.Namespace) -> None:
    pictures = noise() if arguments.film is None else film(arguments.film)
    rows = {"decode": decode(pictures[0])}
    for provider in arguments.provider or ["cpu"]:
        segmenter, _ = open_segmenter(EMBEDDED, "person", Choice(), providers=(provider,))
        rows[f"perceive, {provider}"] = perceive(segmenter, pictures)
        policy = load_policy(DEFAULT, provider)
        rows[f"infer, {policy.info.runs_on}"] = timing.measured_policy(policy, MonotonicClock())
    rows["gate"] = gate()
    rows["log, a second's"] = timing.measured_disk(Path.cwd())
    policy, clock = load_policy(DEFAULT), MonotonicClock()
    rows["lateness"] = timing.measured_lateness(policy, clock, arguments.seconds).seconds
    try:
        with Scheduling(realtime=True).awake(), Scheduling(realtime=True).while_looping():
            late = timing.measured_lateness(policy, clock, arguments.seconds)
        rows["lateness, real time"] = late.seconds
    except UsageError:
        print("real-time priority is not allowed here: adatracker-deploy doctor --fix says how")
    print(f"{machine()}; {'noise' if arguments.film is None else arguments.film.name}\n")
    print("| stage | p50, ms | p95, ms | p99, ms | max, ms |\n|---|---|---|---|---|")
    for name, seconds in rows.items():
        told = [f"{1e3 * value:.2f}" for value in (*np.percentile(seconds, (50, 95, 99)), max(seconds))]
        print(f"| {name} | {' | '.join(told)} |")


def machine() -> str:
    model = Path("/proc/device-tree/model")
    name = model.read_text().strip("\0") if model.exists() else processor()
    load = f"load {os.getloadavg()[0]:.1f}"
    return ", ".join(
        (
            f"{name}, {os.cpu_count()} cores ({platform.machine()})",
            platform.platform(),
            f"Python {platform.python_version()}",
            f"onnxruntime {onnxruntime.__version__}",
            load,
        )
    )


def processor() -> str:
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return next((line.partition(": ")[2] for line in lines if line.startswith("model name")), "processor")


def noise() -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    return [rng.integers(0, 256, (SIZE[1], SIZE[0], 3), np.uint8)]


def film(path: Path) -> list[np.ndarray]:
    capture = cv2.VideoCapture(str(path))
    read = iter(lambda: capture.read()[1], None)
    pictures = [
        cv2.cvtColor(cv2.resize(picture, SIZE), cv2.COLOR_BGR2RGB)
        for picture in itertools.islice(read, TIMES)
    ]
    if not pictures:
        raise SystemExit(f"{path}: no film that OpenCV can read")
    return pictures


def decode(picture: np.ndarray) -> tuple[float, ...]:
    _, jpeg = cv2.imencode(".jpg", cv2.GaussianBlur(picture, (0, 0), 3))  # noise alone is no camera's JPEG
    return timed(lambda: cv2.imdecode(jpeg, cv2.IMREAD_COLOR))


def perceive(segmenter, pictures: list[np.ndarray]) -> tuple[float, ...]:
    clock, numbers = MonotonicClock(), itertools.count()
    segmenter.reset()

    def one() -> None:
        number = next(numbers)
        segmenter(Frame(pictures[number % len(pictures)], clock.now_ns(), number))

    return timed(one)


def gate() -> tuple[float, ...]:
    clock, profile = MonotonicClock(), fake_profile()
    with FakePlatform(profile, clock) as robot:
        robot.connect()
        link = Link(
            robot,
            profile.limits,
            clock,
            lambda: Setpoint(Twist(vx=0.5), clock.now_ns(), None, clock.now_ns()),
        )
        link.engage()
        while link.status.phase is not Phase.ACTIVE:
            link.step(clock.now_ns())
            clock.sleep_until(clock.now_ns() + round(1e9 / RATE_HZ))

        def slot() -> float:
            clock.sleep_until(clock.now_ns() + round(1e9 / RATE_HZ))
            began_s = time.perf_counter()
            link.step(clock.now_ns())
            return time.perf_counter() - began_s

        took = tuple(slot() for _ in range(TIMES))
        link.disengage("done")
        while link.status.phase is not Phase.DONE:
            link.step(clock.now_ns())
            clock.sleep_until(clock.now_ns() + round(1e9 / RATE_HZ))
    return took


def timed(what) -> tuple[float, ...]:
    took = []
    for number in range(TIMES + 5):
        began_s = time.perf_counter()
        what()
        if number >= 5:
            took.append(time.perf_counter() - began_s)
    return tuple(took)


if __name__ == "__main__":
    main()
