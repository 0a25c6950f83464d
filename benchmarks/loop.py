"""Loop rate and lateness: the real loop, link process, virtual camera and PID, on a robot behind no wire.

python benchmarks/loop.py [--seconds 60]
"""

from __future__ import annotations

import argparse
import gc
import time
from dataclasses import replace

import numpy as np

from adatracker_deploy.perception.pipeline import Perception
from adatracker_deploy.perception.segmenter import segment_truth
from adatracker_deploy.perception.world_camera import WorldCamera
from adatracker_deploy.policy.pid import PidPolicy
from adatracker_deploy.runtime.clock import MonotonicClock
from adatracker_deploy.runtime.link import Phase
from adatracker_deploy.runtime.link_process import LinkProcess
from adatracker_deploy.runtime.loop import Loop
from adatracker_deploy.testing.fake import FakePlatform, fake_profile
from adatracker_deploy.world import World

PROFILE = replace(fake_profile(), limits=replace(fake_profile().limits, forward_m_s=1.5, yaw_rate_rad_s=1.5))


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--seconds", type=float, default=60.0)
    seconds = arguments.parse_args().seconds
    clock, records = MonotonicClock(), []
    with LinkProcess(FakePlatform, PROFILE, clock) as link:
        world = World("simple_room", seed=1, obstacles=False)
        link.connect()
        link.engage()
        while (status := link.status()) is None or status.phase is not Phase.ACTIVE:
            time.sleep(0.01)
        camera = WorldCamera(world, PROFILE.sitl.camera, lambda: link.status().state.pose, (160, 160))
        policy = PidPolicy()
        with Perception(camera, segment_truth, clock, rate_hz=30.0) as perception:
            while perception.newest() is None:
                link.send(status.sent, clock.now_ns())
                time.sleep(0.01)
            camera.go()
            loop = Loop(
                observe=perception.newest,
                policy=policy,
                link=link,
                limits=PROFILE.limits,
                clock=clock,
                write=lambda record, _: records.append(record),
            )
            gc.collect()
            gc.freeze()
            cpu_s = time.process_time()
            ending = loop.run(round(seconds * policy.info.rate_hz))
            cpu_s = time.process_time() - cpu_s
    times_s = np.array([record.t_ns for record in records]) / 1e9
    gaps = np.diff(times_s)
    lateness_ms = np.array([record.latency.lateness_ms for record in records])
    sensor_ms = np.array([record.latency.sensor_to_command_ms for record in records])
    elapsed_s = times_s[-1] - times_s[0]
    print(
        f"{ending.outcome}: {len(records)} ticks in {elapsed_s:.1f} s, CPU {cpu_s / elapsed_s:.0%} of a core"
    )
    print(f"rate {(len(records) - 1) / elapsed_s:.3f} Hz, missed slots {records[-1].missed_deadlines}")
    print(f"shortest gap {gaps.min() * 1e3:.1f} ms of {1e3 / policy.info.rate_hz:.0f} ms")
    for name, values in (("lateness", lateness_ms), ("sensor to command", sensor_ms)):
        p50, p99 = np.percentile(values, (50, 99))
        print(f"{name:18s} p50 {p50:6.2f} ms   p99 {p99:6.2f} ms   max {values.max():6.2f} ms")


if __name__ == "__main__":
    main()
