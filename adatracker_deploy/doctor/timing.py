"""Timing checks: measured on this machine, then judged against the loop's budget."""

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
from adatracker_deploy.policy.base import STALE_OBSERVATION_S
from adatracker_deploy.runtime.loop import MISSED_IN_A_ROW
from adatracker_deploy.runtime.pacer import Pacer

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from adatracker_deploy.core.camera import Camera
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.perception.segmenter import Segmenter
    from adatracker_deploy.policy.base import Policy

LATE_P99_S, LATE_MAX_S = 0.002, 0.010
"""Largest lateness of the loop's ticks on a robot, s: 99th percentile, maximum."""
POLICY_SHARE = 0.25
"""Share of the loop's period that the policy's 99th-percentile tick may take; more than half of the period
blocks."""
SLOW_SYNC_S, BLOCKING_SYNC_S = 0.1, 1.0
"""Slowest write and sync of one second of log, s: to warn, to block. The writer's queue holds several
seconds."""
PICTURE = (480, 640)

WORTH_TELLING_S = 0.05
"""Stolen time worth reporting, s; Linux counts it in hundredths of a second."""

_POLICY_TICKS, _PICTURES, _SYNCS = 200, 40, 12
_CAMERA_S = 2.0


@dataclass(frozen=True, slots=True)
class Lateness:
    """Lateness statistics of a loop."""

    seconds: tuple[float, ...]
    missed: int
    """Missed slots in total."""
    in_a_row: int
    """Most consecutive missed slots."""
    stolen_s: float = 0.0
    """Time that a virtual machine's host took from its cores meanwhile, summed."""


def measured_lateness(policy: Policy, clock: Clock, seconds: float) -> Lateness:
    """Run only the loop's pacer and the policy for this long."""
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
    """Check the loop; as many consecutive missed slots as would end a trial block."""
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
    """Return the duration of several warm policy ticks, s."""
    policy.reset()
    observation = _nothing(clock)
    return _timed(lambda: policy.act(observation), _POLICY_TICKS)


def policy_check(seconds: Sequence[float], rate_hz: float, runs_on: str) -> Check:
    """Check the policy's ticks against the loop's period; `runs_on` is the provider, empty without one."""
    p50, p99, _ = _percentiles(seconds)
    share = p99 * rate_hz
    where = f"on {runs_on} " if runs_on else ""
    told = f"{where}a tick takes p50 {p50 * 1e3:.2f}, p99 {p99 * 1e3:.2f} ms of {1e3 / rate_hz:.0f}"
    if share < POLICY_SHARE:
        return Check("policy", True, told)
    return Check("policy", False, f"{told}: a smaller network, or a faster machine", blocking=share > 0.5)


def measured_perception(segmenter: Segmenter, clock: Clock) -> tuple[float, ...]:
    """Return the warm perception times for 640x480 images of noise, s; nobody is found in them."""
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 256, (*PICTURE, 3), np.uint8)
    segmenter.reset()
    now_ns = clock.now_ns()
    frames = iter(Frame(picture, now_ns + number * 50_000_000, number) for number in range(_PICTURES + 3))
    return _timed(lambda: segmenter(next(frames)), _PICTURES)


def perception_check(seconds: Sequence[float], runs_on: str) -> Check:
    """Check the segmenter; block if its results would be too old to use; `runs_on` says what runs where."""
    p50, p95 = np.percentile(seconds, (50, 95))
    told = f"640x480 takes p50 {p50 * 1e3:.0f}, p95 {p95 * 1e3:.0f} ms, more with people in it ({runs_on})"
    if p95 < STALE_OBSERVATION_S / 3:
        return Check("perception", True, told)
    mend = f"pictures older than {STALE_OBSERVATION_S:g} s stop the robot: a faster model or provider"
    return Check("perception", False, f"{told}; {mend}", blocking=bool(p50 > STALE_OBSERVATION_S))


def measured_disk(folder: Path) -> tuple[float, ...]:
    """Return several times, s, to write and sync one second's worth of log."""
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
    """Check the disk under the logs."""
    p50, _, most = _percentiles(seconds)
    told = f"a second of a trial is written and synced in p50 {p50 * 1e3:.0f}, at most {most * 1e3:.0f} ms"
    if most < SLOW_SYNC_S:
        return Check("disk speed", True, told)
    mend = "log to another disk with --log-dir"
    return Check("disk speed", False, f"{told}: {mend}", blocking=p50 > BLOCKING_SYNC_S)


def measured_camera(camera: Camera, clock: Clock) -> tuple[float, tuple[int, int]]:
    """Return an open camera's frame rate, Hz, and its frames' height and width.

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
    """Check a camera against the policy's rate."""
    told = f"{shape[1]}x{shape[0]} at {rate_hz:.1f} Hz"
    ok = rate_hz >= 0.95 * policy_hz
    mend = (
        ""
        if ok
        else f": the policy runs at {policy_hz:g} Hz and would act on pictures twice; more light, or MJPG"
    )
    return Check("camera", ok, told + mend, blocking=rate_hz * STALE_OBSERVATION_S < 1)


def _nothing(clock: Clock) -> Observation:
    mask, image = np.zeros((MASK_SIZE, MASK_SIZE), np.uint8), np.zeros((*PICTURE, 3), np.uint8)
    return Observation(mask, None, 0.0, clock.now_ns(), 0, image=image)


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
