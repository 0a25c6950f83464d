"""What takes time: measured on this machine by running it, then judged against the loop's budget."""

from __future__ import annotations

import gc
import os
import time
from dataclasses import dataclass
from tempfile import TemporaryFile
from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.core.messages import Frame, Observation
from adatracker_deploy.doctor.machine import LOG_BYTES_PER_S, stolen_s
from adatracker_deploy.perception.drawing import MASK_SIZE
from adatracker_deploy.platform import Check
from adatracker_deploy.runtime.loop import MISSED_IN_A_ROW, STALE_OBSERVATION_S
from adatracker_deploy.runtime.pacer import Pacer

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from adatracker_deploy.core.camera import Camera
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.perception.segmenter import Segmenter
    from adatracker_deploy.policy.base import Policy

LATE_P99_S, LATE_MAX_S = 0.002, 0.010
"""Of the loop's ticks, on a robot."""
POLICY_SHARE = 0.25
"""Of the loop's period, that a policy's slowest tick of a hundred may take; half of it refuses."""
SLOW_SYNC_S, BLOCKING_SYNC_S = 0.1, 1.0
"""For what the log writes in a second, at the slowest; the writer's queue holds several seconds."""
PICTURE = (480, 640)

WORTH_TELLING_S = 0.05
"""Of stolen time; Linux counts it in hundredths of a second."""

_POLICY_TICKS, _PICTURES, _SYNCS = 200, 40, 12
_CAMERA_S = 2.0


@dataclass(frozen=True, slots=True)
class Lateness:
    """How late a loop's ticks were."""

    seconds: tuple[float, ...]
    missed: int
    """Slots, all together."""
    in_a_row: int
    """Slots, at the worst."""
    stolen_s: float = 0.0
    """What a virtual machine's host took of its cores meanwhile, all together."""


def measured_lateness(policy: Policy, clock: Clock, seconds: float) -> Lateness:
    """Run the loop's pacer with the policy in it, and nothing else, for this long."""
    policy.reset()
    observation = _nothing(clock)
    policy.act(observation)
    gc.collect()
    gc.freeze()
    try:
        pacer = Pacer(clock, policy.info.rate_hz)
        late, worst, before_s = [], 0, stolen_s()
        for _ in range(max(1, round(seconds * policy.info.rate_hz))):
            tick = pacer.wait()
            policy.act(observation)
            late.append(tick.lateness_s)
            worst = max(worst, tick.skipped)
    finally:
        gc.unfreeze()
    return Lateness(tuple(late), pacer.missed, worst, stolen_s() - before_s)


def lateness_check(late: Lateness, rate_hz: float) -> Check:
    """Judge the loop; as many slots missed in a row as end a trial refuse."""
    p50, p99, most = _percentiles(late.seconds)
    told = f"at {rate_hz:g} Hz late by p50 {p50 * 1e3:.1f}, p99 {p99 * 1e3:.1f}, at most {most * 1e3:.1f} ms"
    told += f", {late.missed} slots missed" if late.missed else ", no slot missed"
    if p99 < LATE_P99_S and most < LATE_MAX_S and not late.missed:
        return Check("loop", True, told)
    mend = "stop what else runs here, give it real-time priority with --realtime, or a machine of its own"
    if late.stolen_s >= WORTH_TELLING_S:
        told += f"; meanwhile the host of this virtual machine took {late.stolen_s:.2f} s of its cores"
        mend = "no priority helps against that; keep more of its processors' time free, or use a real machine"
    return Check("loop", False, f"{told}: {mend}", blocking=late.in_a_row >= MISSED_IN_A_ROW)


def measured_policy(policy: Policy, clock: Clock) -> tuple[float, ...]:
    """Return the seconds of some ticks of the policy, warm."""
    policy.reset()
    observation = _nothing(clock)
    return _timed(lambda: policy.act(observation), _POLICY_TICKS)


def policy_check(seconds: Sequence[float], rate_hz: float) -> Check:
    """Judge the policy's ticks against the loop's period."""
    p50, p99, _ = _percentiles(seconds)
    share = p99 * rate_hz
    told = f"a tick takes p50 {p50 * 1e3:.2f}, p99 {p99 * 1e3:.2f} ms of {1e3 / rate_hz:.0f}"
    if share < POLICY_SHARE:
        return Check("policy", True, told)
    return Check("policy", False, f"{told}: a smaller network, or a faster machine", blocking=share > 0.5)


def measured_perception(segmenter: Segmenter, clock: Clock) -> tuple[float, ...]:
    """Return the seconds that pictures of 640x480 take, warm; of noise, so that nobody is found in them."""
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 256, (*PICTURE, 3), np.uint8)
    segmenter.reset()
    now_ns = clock.now_ns()
    frames = iter(Frame(picture, now_ns + number * 50_000_000, number) for number in range(_PICTURES + 3))
    return _timed(lambda: segmenter(next(frames)), _PICTURES)


def perception_check(seconds: Sequence[float]) -> Check:
    """Judge the segmenter; pictures that would be too old when they are understood refuse."""
    p50, p95 = np.percentile(seconds, (50, 95))
    told = f"640x480 takes p50 {p50 * 1e3:.0f}, p95 {p95 * 1e3:.0f} ms, more with people in it"
    if p95 < STALE_OBSERVATION_S / 3:
        return Check("perception", True, told)
    mend = f"pictures older than {STALE_OBSERVATION_S:g} s stop the robot: a faster model or provider"
    return Check("perception", False, f"{told}; {mend}", blocking=bool(p50 > STALE_OBSERVATION_S))


def measured_disk(folder: Path) -> tuple[float, ...]:
    """Return how many seconds it takes to write and sync what a second of a trial writes, a few times."""
    data = os.urandom(LOG_BYTES_PER_S)
    took = []
    with TemporaryFile(dir=folder) as file:
        for _ in range(_SYNCS):
            began_s = time.perf_counter()
            file.write(data)
            file.flush()
            os.fdatasync(file.fileno())
            took.append(time.perf_counter() - began_s)
    return tuple(took)


def disk_check(seconds: Sequence[float]) -> Check:
    """Judge the disk under the logs."""
    p50, _, most = _percentiles(seconds)
    told = f"a second of a trial is written and synced in p50 {p50 * 1e3:.0f}, at most {most * 1e3:.0f} ms"
    if most < SLOW_SYNC_S:
        return Check("disk speed", True, told)
    mend = "log to another disk with --log-dir"
    return Check("disk speed", False, f"{told}: {mend}", blocking=p50 > BLOCKING_SYNC_S)


def measured_camera(camera: Camera, clock: Clock) -> tuple[float, tuple[int, int]]:
    """Return the frames a second of an open camera, and their height and width.

    Raises:
        PlatformError: it gives no frames.
    """
    end_ns = clock.now_ns() + round(_CAMERA_S * 1e9)
    times, shape = {}, (0, 0)
    while clock.now_ns() < end_ns:
        frame = camera.read(clock.now_ns())
        if frame is not None:
            times[frame.seq] = frame.t_ns
            shape = frame.rgb.shape[0], frame.rgb.shape[1]
        clock.sleep_until(clock.now_ns() + 2_000_000)
    spans = (max(times.values()) - min(times.values())) / 1e9 if times else 0.0
    return (len(times) - 1) / spans if spans else 0.0, shape


def camera_check(rate_hz: float, shape: tuple[int, int], policy_hz: float) -> Check:
    """Judge a camera against the policy's rate."""
    told = f"{shape[1]}x{shape[0]} at {rate_hz:.1f} Hz"
    ok = rate_hz >= 0.95 * policy_hz
    mend = (
        ""
        if ok
        else f": the policy runs at {policy_hz:g} Hz and would act on pictures twice; more light, or MJPG"
    )
    return Check("camera", ok, told + mend, blocking=rate_hz * STALE_OBSERVATION_S < 1)


def _nothing(clock: Clock) -> Observation:
    return Observation(np.zeros((MASK_SIZE, MASK_SIZE), np.uint8), None, 0.0, clock.now_ns(), 0)


def _timed(what: Callable[[], object], times: int) -> tuple[float, ...]:
    took = []
    for number in range(times + 3):
        began_s = time.perf_counter()
        what()
        if number >= 3:  # warm
            took.append(time.perf_counter() - began_s)
    return tuple(took)


def _percentiles(seconds: Sequence[float]) -> tuple[float, float, float]:
    p50, p99 = np.percentile(seconds, (50, 99))
    return float(p50), float(p99), max(seconds)
