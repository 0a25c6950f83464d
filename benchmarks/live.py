"""Cost of the log and the live view for the loop: lateness and processor time with and without them.

python benchmarks/live.py [--seconds 20] [--rounds 6] [--awake]

The real loop, link process, perception thread and log writer at 20 Hz, with pictures of 640x480 at 30 Hz
that lie ready in memory: decoded, and as the JPEGs that network cameras and ROS topics send; a camera of raw
pictures, whose JPEGs the writer makes itself, is a case of its own. Masks are of the size that perception
makes. The cases take turns, each round beginning with another, so that whatever else the machine does meets
each of them; a case's p99 is the median of its rounds'.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.messages import Box, Frame, MaskClass, Observation
from adatracker_deploy.perception.drawing import MASK_SIZE
from adatracker_deploy.perception.pipeline import Perception
from adatracker_deploy.policy.pid import PidPolicy
from adatracker_deploy.runtime.gate import Setpoint
from adatracker_deploy.runtime.link import Phase
from adatracker_deploy.runtime.link_process import LinkProcess
from adatracker_deploy.runtime.loop import Loop
from adatracker_deploy.runtime.scheduling import Scheduling
from adatracker_deploy.testing.fake import FakePlatform, fake_profile
from adatracker_deploy.trial.channels import JPEG_QUALITY
from adatracker_deploy.trial.live_port import choose_port, websocket_url
from adatracker_deploy.trial.log import TrialLog

WIDTH, HEIGHT, CAMERA_HZ = 640, 480, 30.0
PROFILE = replace(fake_profile(), limits=replace(fake_profile().limits, forward_m_s=1.5, yaw_rate_rad_s=1.5))
CASES = {
    "neither log nor view": (),
    "log": ("log",),
    "log of a camera of raw pictures": ("log", "raw"),
    "log, view that nobody watches": ("log", "live"),
    "log, view, a viewer": ("log", "live", "reading"),
    "log, view, a viewer that never reads": ("log", "live", "asleep"),
}


class ReadyCamera:
    """Pictures with a person in them that walks from side to side, and what is to be seen in each."""

    def __init__(self) -> None:
        rng = np.random.default_rng(0)
        room = cv2.resize(
            rng.integers(60, 200, (HEIGHT // 16, WIDTH // 16, 3), np.uint8), (WIDTH, HEIGHT), interpolation=2
        )
        self.shown = []
        for phase in np.linspace(0, 2 * np.pi, 32, endpoint=False):
            picture = cv2.add(room, rng.integers(0, 12, room.shape, np.uint8))
            left = round(WIDTH * (0.42 + 0.1 * np.sin(phase)))
            large = np.zeros((HEIGHT, WIDTH), np.uint8)
            large[120:400, left : left + 100] = MaskClass.TARGET
            picture[large == MaskClass.TARGET] //= 2
            mask = cv2.resize(large, (MASK_SIZE, MASK_SIZE), interpolation=cv2.INTER_NEAREST)
            _, jpeg = cv2.imencode(".jpg", picture[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))
            self.shown.append((picture, mask, Box.of_mask(mask), jpeg.tobytes()))
        self.frame: Frame | None = None

    def open(self) -> None:
        """Everything is ready."""

    def read(self, now_ns: int) -> Frame:
        seq = int(now_ns * CAMERA_HZ / 1e9)
        if self.frame is None or self.frame.seq != seq:
            picture, _, _, jpeg = self.shown[seq % len(self.shown)]
            self.frame = Frame(picture, now_ns, seq, jpeg=jpeg)
        return self.frame

    def segment(self, frame: Frame) -> Observation:
        _, mask, box, _ = self.shown[frame.seq % len(self.shown)]
        return Observation(mask, box, 1.0, frame.t_ns, frame.seq)

    def go(self) -> None:
        """Nobody waits."""

    def close(self) -> None:
        """Nothing is held."""


@dataclass
class Case:
    """The measurements of one of `CASES`."""

    lateness_ms: list[np.ndarray] = field(default_factory=list)
    missed: int = 0
    dropped: int = 0
    loop_cpu: list[float] = field(default_factory=list)
    writer_cpu: list[float] = field(default_factory=list)
    stolen: list[float] = field(default_factory=list)
    seen_hz: list[float] = field(default_factory=list)
    """Messages that the viewer took."""

    def p99s_ms(self) -> list[float]:
        return [float(np.percentile(lateness_ms, 99)) for lateness_ms in self.lateness_ms]


def run(case: Case, parts: tuple[str, ...], camera: ReadyCamera, seconds: float, folder: Path) -> bool:
    """Run the loop once; tell whether it ran to its end, without which nothing counts."""
    clock, records = MonotonicClock(), []
    policy = PidPolicy()
    with contextlib.ExitStack() as stack:
        link = stack.enter_context(LinkProcess(FakePlatform, PROFILE, clock))
        link.connect()
        log = viewer = None
        if parts:
            port = choose_port(0) if "live" in parts else None
            log = stack.enter_context(
                TrialLog.create(
                    folder,
                    platform="fake",
                    kind="dry",
                    policy="pid",
                    steps=0,
                    config={},
                    now_ns=clock.now_ns(),
                    live_port=port,
                )
            )
        if {"reading", "asleep"} & set(parts):
            viewer = stack.enter_context(started_viewer(port, parts[-1]))
        link.engage()
        while (status := link.status()) is None or status.phase is not Phase.ACTIVE:
            time.sleep(0.01)

        def write(record, seen) -> None:
            records.append(record)
            if log is not None:
                frame = replace(seen.frame, jpeg=None) if "raw" in parts else seen.frame
                log.step(record, frame, seen.observation)

        perception = stack.enter_context(Perception(camera, camera.segment, clock, rate_hz=200.0))
        while perception.newest() is None:
            link.send(Setpoint(status.sent, clock.now_ns()))
            time.sleep(0.01)
        loop = Loop(
            observe=perception.newest,
            policy=policy,
            link=link,
            limits=PROFILE.limits,
            clock=clock,
            write=write,
        )
        gc.collect()
        gc.freeze()
        link.send(Setpoint(status.sent, clock.now_ns()))
        writer_s = cpu_s(log.writer_pid) if log else 0.0
        loop_s, began_s, machine = time.process_time(), time.perf_counter(), machine_ticks()
        ending = loop.run(round(seconds * policy.info.rate_hz))
        spent_s = time.perf_counter() - began_s
        gc.unfreeze()
        if viewer is not None:
            viewer.stdin.close()
            case.seen_hz.append(int(viewer.stdout.readline()) / spent_s)
        if ending.outcome != "completed":
            print(f"run again, for the loop ended: {ending}", file=sys.stderr)
            return False
        case.loop_cpu.append((time.process_time() - loop_s) / spent_s)
        case.writer_cpu.append((cpu_s(log.writer_pid) - writer_s) / spent_s if log else 0.0)
        stolen, total = np.subtract(machine_ticks(), machine)
        case.stolen.append(stolen / total)
    case.lateness_ms.append(np.array([record.latency.lateness_ms for record in records]))
    case.missed += records[-1].missed_deadlines
    if log is not None:
        case.dropped += log.dropped + log.frames_dropped
        for file in log.folder.iterdir():
            file.unlink()
    return True


def cpu_s(pid: int) -> float:
    """Processor time of a process so far, by proc(5)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def machine_ticks() -> tuple[int, int]:
    """Ticks that the host took from this machine, and all, by proc(5)."""
    ticks = list(map(int, Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:9]))
    return ticks[7], sum(ticks)


@contextlib.contextmanager
def started_viewer(port: int, how: str):
    """Give a viewer in a process of its own that has subscribed to everything."""
    command = (sys.executable, __file__, "--view", str(port), "--how", how)
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        process.stdout.readline()
        yield process


def view(port: int, how: str) -> None:
    """Subscribe to everything; read, or do not; in the end, when stdin closes, say how many messages came."""
    import threading

    from websockets.sync.client import connect

    ending = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ending.set()), daemon=True).start()
    with connect(
        websocket_url(port), subprotocols=["foxglove.sdk.v1"], max_size=None, max_queue=1, ping_interval=None
    ) as websocket:
        websocket.recv()
        channels = json.loads(websocket.recv())["channels"]
        subscriptions = [{"id": channel["id"], "channelId": channel["id"]} for channel in channels]
        websocket.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))
        print("subscribed", flush=True)
        seen = 0
        while how == "reading" and not ending.is_set():
            with contextlib.suppress(TimeoutError):
                websocket.recv(timeout=0.2)
                seen += 1
        ending.wait()
        print(seen, flush=True)
        os._exit(0)  # one that was asleep cannot take leave


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--rounds", type=int, default=6)
    parser.add_argument("--awake", action="store_true", help="keep cores awake, as --realtime does")
    parser.add_argument("--view", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--how", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.view is not None:
        view(args.view, args.how)
    camera = ReadyCamera()
    cases = {name: Case() for name in CASES}
    with tempfile.TemporaryDirectory() as folder, Scheduling(args.awake).awake():
        names = list(CASES)
        for number in range(args.rounds):
            for name in names[number % len(names) :] + names[: number % len(names)]:
                while not run(cases[name], CASES[name], camera, args.seconds, Path(folder)):
                    pass
    ticks = sum(map(len, cases["log"].lateness_ms))
    print(f"{ticks} ticks each; lateness in ms; processor time in % of a core; stolen: by the host, % of all")
    print(f"{'':36}  p50    p99  of all    max  missed  dropped   loop  writer  stolen")
    for name, case in cases.items():
        all_ms = np.concatenate(case.lateness_ms)
        p50_ms, p99_ms = np.percentile(all_ms, (50, 99))
        print(
            f"{name:36} {p50_ms:4.2f} {statistics.median(case.p99s_ms()):6.2f} {p99_ms:7.2f} "
            f"{all_ms.max():6.1f} {case.missed:7} {case.dropped:8} {statistics.mean(case.loop_cpu):6.1%} "
            f"{statistics.mean(case.writer_cpu):7.1%} {statistics.mean(case.stolen):7.1%}"
        )
    seen_hz = statistics.mean(cases["log, view, a viewer"].seen_hz)
    print(f"the viewer that reads took {seen_hz:.0f} messages a second")
    without, with_all = (cases[name].p99s_ms() for name in ("neither log nor view", "log, view, a viewer"))
    change_ms = statistics.median(with_all) - statistics.median(without)
    changes_ms = [b - a for a, b in zip(without, with_all, strict=True)]
    print(
        f"log, view and a viewer change p99 by {change_ms:+.2f} ms; round by round by "
        f"{statistics.median(changes_ms):+.2f} ms ({min(changes_ms):+.2f} to {max(changes_ms):+.2f})"
    )


if __name__ == "__main__":
    main()
