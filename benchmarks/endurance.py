"""Does anything grow? Memory, threads and open files over 200 starts and stops, and over a long trial.

Run with ``python benchmarks/endurance.py [--cycles 200] [--minutes 30] [--platform NAME]``; 0 leaves one out.

A cycle is a whole trial of a few ticks against a simulated robot that goes on running, as a real one would:
connect, open the camera, engage, drive, stop, disengage, close the log. What is looked at is this process,
which is the tracker, and the robot; the link and the log's writer end with their cycle, and none may be left.
The long run is one trial; all its processes are looked at.

Flat is what does not grow between the second quarter and the last by more than `GROWTH` and `GROWTH_MB`.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import os
import statistics
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path
from typing import NamedTuple

from rehearsals import children, machine, rehearsal

from adatracker_deploy.errors import PlatformError
from adatracker_deploy.runtime.clock import MonotonicClock
from adatracker_deploy.trial_run import run_trial

GROWTH, GROWTH_MB = 0.03, 3.0
TICKS = 10
RATE_HZ = 20.0
SAMPLES = 60
"""Of a long run."""
NAMES = {"adatracker-link": "link", "trial.writer": "log", "_wheeled": "robot", "_drone": "robot"}
NAMES |= {"_quadruped": "robot"}


class Sample(NamedTuple):
    """What a process has."""

    memory_mb: float
    threads: int
    files: int


class Silent:
    """Is told how a trial goes, and says nothing."""

    def phase(self, text): ...

    def step(self, record): ...


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


def name_of(pid):
    """Say which of a trial's processes it is."""
    words = Path(f"/proc/{pid}/comm").read_text() + Path(f"/proc/{pid}/cmdline").read_text()
    return next((name for mark, name in NAMES.items() if mark in words), "helper")


def family(pid):
    """Return the processes below one, with their names; those of one name are numbered."""
    found, count = {}, Counter()
    for child in children(pid):
        with contextlib.suppress(FileNotFoundError):
            name = name_of(child)
            count[name] += 1
            found[child] = name if count[name] == 1 else f"{name} {count[name]}"
            found |= {pid: f"{found[child]}'s {name}" for pid, name in family(child).items()}
    return found


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
        before, after = (max(getattr(one, what) for one in part) for part in (early, late))
        if after > before:
            wrong.append(f"{what} {before} to {after}")
    return wrong


def cycles(platform, count, folder):
    """Start and stop a robot that goes on running; return whether all stayed flat."""
    plan = rehearsal(platform, folder, TICKS, target_speed_m_s=0.0)
    endings, left, slowest_s = Counter(), 0, 0.0
    began_s = time.monotonic()
    with plan.platform.sitl(plan.profile) as far_end:
        profile = far_end.start(MonotonicClock(), plan.scenario)
        plan = dataclasses.replace(plan, profile=profile, sitl=False)
        before = set(family(os.getpid()))
        series = {"tracker": [], "robot": []}
        for _ in range(count):
            cycle_s = time.monotonic()
            try:
                summary = run_trial(plan, Silent(), cycle_s)
                endings[summary["reason"] or summary["outcome"]] += 1
            except PlatformError as error:
                endings[str(error)] += 1
            slowest_s = max(slowest_s, time.monotonic() - cycle_s)
            series["tracker"].append(sample(os.getpid()))
            series["robot"].append(sample(far_end.pid))
            after = family(os.getpid())
            if len(series["tracker"]) % 20 == 0:
                print(f"  {len(series['tracker'])} cycles: {series['tracker'][-1]}", flush=True)
            left += sum(name in {"link", "log"} for pid, name in after.items() if pid not in before)
    seconds = time.monotonic() - began_s
    title = f"{count} cycles of {TICKS} ticks in {seconds:.0f} s, the slowest {slowest_s:.1f} s"
    flat = table(title, series, 10)
    print(f"  ended: {', '.join(f'{number} x {ending}' for ending, number in endings.most_common())}")
    print(f"  links and log writers left behind: {left}")
    return flat and left == 0


def long_run(platform, minutes, folder):
    """Run one trial, and look at its processes all the while; return whether all stayed flat."""
    series, ending = {}, threading.Event()

    def look():
        while not ending.wait(minutes * 60 / SAMPLES):
            for pid, name in {os.getpid(): "tracker", **family(os.getpid())}.items():
                series.setdefault(name, []).append(sample(pid))

    thread = threading.Thread(target=look)
    thread.start()
    began_s = time.monotonic()
    try:
        summary = run_trial(rehearsal(platform, folder, round(minutes * 60 * RATE_HZ)), Silent(), began_s)
    finally:
        ending.set()
        thread.join()
    flat = table(f"one trial of {summary['seconds'] / 60:.1f} of {minutes:g} min", series, 10)
    print(f"  {summary['outcome']} {summary['reason']}, {summary['missed_deadlines']} slots missed")
    return flat


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--cycles", type=int, default=200)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--platform", default="wheeled")
    options = parser.parse_args()
    print(f"{options.platform}, {time.strftime('%Y-%m-%d')}, {machine()}")
    flat = True
    with tempfile.TemporaryDirectory() as folder:
        if options.cycles:
            flat &= cycles(options.platform, options.cycles, Path(folder))
        if options.minutes:
            flat &= long_run(options.platform, options.minutes, Path(folder))
    print("\nflat" if flat else "\nNOT FLAT")
    raise SystemExit(0 if flat else 1)


if __name__ == "__main__":
    main()
