"""Does anything grow? Memory, threads and open files over starts and stops, and over a long trial.

Run with ``python benchmarks/endurance.py [--cycles 200] [--trials 20] [--minutes 30] [--platform NAME]
[--speed 1]``; a part that gets 0 is left out.

All starts and stops are of one simulated robot that goes on running, as a real one would. A cycle connects,
engages, drives, disengages and closes, with adapter and link in this process. A trial is a whole one of a few
ticks: link, camera, perception, policy and log as well; its processes end with it, and none may be left. The
long run is one trial, at ``--speed`` times real time, followed by another when a protective stop ends it; all
processes are looked at.

Flat is what does not grow between the second quarter and the last, median by median: memory by no more than
`GROWTH` or `GROWTH_MB`, threads and files not at all.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import math
import os
import statistics
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path
from typing import NamedTuple

from rehearsals import family, favour_robot, machine, rehearsal

from adatracker_deploy.app.trial_run import run_trial
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.runtime.gate import Setpoint
from adatracker_deploy.runtime.link import RATE_HZ as LINK_HZ
from adatracker_deploy.runtime.link import Link, Phase
from adatracker_deploy.runtime.link_process import wall_timeouts
from adatracker_deploy.runtime.pacer import Pacer
from adatracker_deploy.runtime.scheduling import Scheduling

GROWTH, GROWTH_MB = 0.03, 3.0
TICKS = 10
RATE_HZ = 20.0
SAMPLES = 120
"""Number of samples of a long run."""
COLUMNS = 10


class Sample(NamedTuple):
    """The resources of a process."""

    memory_mb: float
    threads: int
    files: int


class Silent:
    """Is told how a trial goes, and says nothing but whether it is driving."""

    _stepped_s = -math.inf

    def phase(self, text):
        if text.startswith("following"):
            favour_robot()

    def logging(self, folder): ...

    def step(self, _):
        self._stepped_s = time.monotonic()

    @property
    def driving(self):
        return time.monotonic() - self._stepped_s < 0.5


def sample(pid):
    """Look at a process; None when it has ended."""
    try:
        status = dict(
            line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines() if ":" in line
        )
        files = len(list(Path(f"/proc/{pid}/fd").iterdir()))
        return Sample(int(status["VmRSS"].split()[0]) / 1024, int(status["Threads"]), files)
    except (FileNotFoundError, KeyError):
        return None


def table(title, series, number):
    """Print what processes had over time, and whether that is flat."""
    print(f"\n{title}")
    flat = True
    for name, samples in series.items():
        kept = [one for one in samples if one is not None]
        if len(kept) < 8:
            continue
        shown = [kept[round(place * (len(kept) - 1) / (number - 1))] for place in range(number)]
        for what, values, digits in (
            ("MB", [one.memory_mb for one in shown], 1),
            ("threads", [one.threads for one in shown], 0),
            ("files", [one.files for one in shown], 0),
        ):
            print(f"  {name:12s} {what:8s}" + " ".join(f"{value:6.{digits}f}" for value in values))
        wrong = growing(kept)
        flat &= not wrong
        print(f"  {name:12s} {'GROWS: ' + ', '.join(wrong) if wrong else 'flat'}")
    return flat


def growing(samples):
    """Name what grew from the second quarter to the last."""
    quarter = len(samples) // 4
    early, late = samples[quarter : 2 * quarter], samples[-quarter:]
    before, after = (statistics.median(one.memory_mb for one in part) for part in (early, late))
    wrong = []
    if after - before > max(GROWTH_MB, GROWTH * before):
        wrong.append(f"memory {before:.1f} to {after:.1f} MB")
    for what in ("threads", "files"):
        before, after = (statistics.median(getattr(one, what) for one in part) for part in (early, late))
        if after > before:
            wrong.append(f"{what} {before} to {after}")
    return wrong


def started_and_stopped(title, plan, count, start_and_stop):
    """Start and stop a robot that goes on running; return whether all stayed flat."""
    endings, slowest_s, began_s = Counter(), 0.0, time.monotonic()
    series = {"tracker": [], "robot": []}
    clock = MonotonicClock()
    with plan.platform.sitl(plan.profile) as simulator:
        profile = simulator.start(clock, plan.scenario)
        for _ in range(count):
            cycle_s = time.monotonic()
            try:
                endings[start_and_stop(profile, clock)] += 1
            except PlatformError as error:
                endings[str(error)] += 1
            slowest_s = max(slowest_s, time.monotonic() - cycle_s)
            series["tracker"].append(sample(os.getpid()))
            series["robot"].append(sample(simulator.pid))
        after = family(os.getpid())
        left = {name for name in after.values() if name.startswith(("link", "log"))}
    seconds = time.monotonic() - began_s
    flat = table(f"{count} {title} in {seconds:.0f} s, the slowest {slowest_s:.1f} s", series, COLUMNS)
    print(f"  ended: {', '.join(f'{number} x {ending}' for ending, number in endings.most_common())}")
    print(f"  processes left behind: {', '.join(sorted(left)) or 'none'}", flush=True)
    return flat and not left


def cycles(plan, count):
    """Engage and disengage, with adapter and link in this process."""

    def drive(profile, clock):
        robot = plan.platform(profile, clock)
        with contextlib.closing(robot):
            robot.connect()
            robot.preflight()
            limits = wall_timeouts(profile.limits, clock.speed)
            link = Link(robot, limits, clock, lambda: Setpoint(Twist(vx=0.1), clock.now_ns()))
            link.engage()
            pacer, active = Pacer(clock, LINK_HZ), 0
            while link.status.phase is not Phase.DONE:
                active += link.step(pacer.wait().t_ns).phase is Phase.ACTIVE
                if active == TICKS or link.status.phase is Phase.HOLDING:
                    link.disengage("enough")
            return link.status.stopped

    return started_and_stopped(f"cycles of {TICKS} slots", plan, count, drive)


def trials(plan, count):
    """Run whole trials of a few ticks."""

    def run(profile, _):
        summary = run_trial(dataclasses.replace(plan, profile=profile, sitl=False), Silent(), 0.0)
        return summary["reason"] or summary["outcome"]

    return started_and_stopped(f"trials of {TICKS} ticks", plan, count, run)


def long_run(plan, minutes):
    """Drive for so long, and look at all processes while they do; return whether all stayed flat."""
    series, endings, driven_s, missed = {}, Counter(), 0.0, 0
    ending, clock, progress = threading.Event(), MonotonicClock(plan.speed), Silent()

    def look():
        while not ending.wait(minutes * 60 / SAMPLES):
            if not progress.driving:
                continue
            for pid, name in {os.getpid(): "tracker", **family(os.getpid())}.items():
                series.setdefault(name, []).append(sample(pid))

    with plan.platform.sitl(plan.profile) as simulator:
        plan = dataclasses.replace(plan, profile=simulator.start(clock, plan.scenario), sitl=False)
        thread = threading.Thread(target=look)
        thread.start()
        end_s = time.monotonic() + minutes * 60
        try:
            while (left_s := end_s - time.monotonic()) > 0:
                try:
                    steps = max(1, round(left_s * RATE_HZ * plan.speed))
                    summary = run_trial(dataclasses.replace(plan, steps=steps), progress, 0.0)
                except PlatformError as error:
                    endings[str(error)] += 1
                    continue
                endings[summary["reason"] or summary["outcome"]] += 1
                driven_s += summary["seconds"]
                missed += summary["missed_deadlines"]
        finally:
            ending.set()
            thread.join()
    driven = f"{driven_s / 60 / plan.speed:.1f} of them driving, for {driven_s / 60:.1f} min of the robot's"
    flat = table(f"{minutes:g} min at --speed {plan.speed:g}, {driven}", series, COLUMNS)
    print(f"  ended: {', '.join(f'{number} x {end}' for end, number in endings.most_common())}")
    print(f"  {missed} slots missed", flush=True)
    return flat


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--cycles", type=int, default=200)
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--platform", default="wheeled")
    parser.add_argument("--speed", type=float, default=1.0, help="of the long run, times real time")
    parser.add_argument("--realtime", action="store_true", help="SCHED_FIFO for loop and link")
    options = parser.parse_args()
    scheduling = Scheduling(options.realtime)
    scheduling.check()
    print(f"{options.platform}, {time.strftime('%Y-%m-%d')}, {machine()}")
    flat = True
    with tempfile.TemporaryDirectory() as folder:
        plan = rehearsal(options.platform, Path(folder), TICKS, target_speed_m_s=0.0)
        if options.cycles:
            flat &= cycles(plan, options.cycles)
        if options.trials:
            flat &= trials(plan, options.trials)
        if options.minutes:
            plan = dataclasses.replace(plan, scheduling=scheduling, speed=options.speed)
            flat &= long_run(plan, options.minutes)
    print("\nflat" if flat else "\nNOT FLAT")
    raise SystemExit(0 if flat else 1)


if __name__ == "__main__":
    main()
