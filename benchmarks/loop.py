"""Timing of the loop: whole rehearsals at 20 Hz, with and without a log, idle and beside CPU hogs.

Run with ``python benchmarks/loop.py [--minutes 10] [--hogs 0 4] [--rest MS] [--log yes no]
[--awake | --asleep] [--realtime] [--cpu LIST]``.

The simulated robot is started once a row and goes on running. It stands for a machine of its own: where the
system allows, it is given precedence over all else here (nice -18). The hogs begin when the loop does.

Every row is so many minutes of `run_trial`, link, camera and perception included; a trial that ends sooner (a
protective stop: a machine too busy is a reason for one) is followed by another. Times are those of the ticks
as they are logged. The shortest interval is that between two set-points handed to the link, and in brackets
that between two ticks, which is what the loop promises: half a period. The rate is ticks over time; without
drift it is 20 Hz less what was missed. Stolen is what a host took of all cores together.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import itertools
import os
import tempfile
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
from rehearsals import cpu_hogs, favour_robot, machine, rehearsal

from adatracker_deploy.app.trial_run import run_trial
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.doctor.machine import stolen_s
from adatracker_deploy.runtime.scheduling import Scheduling, read_cpus

RATE_HZ = 20.0
RATE_WITHIN = 0.001
HEAD = (
    "hogs | log | stolen s | s | trials | Hz | missed | shortest ms | lateness p50 / p99 / max ms | "
    "wire p50 / p99 ms |"
)
GIVE_UP = 3.0
"""Times the minutes asked for, by the clock on the wall."""


class Recorder:
    """Keeps every tick of one trial; calls `hogs` when its loop begins."""

    def __init__(self, hogs):
        self.records = []
        self._hogs = hogs

    def phase(self, text):
        if text.startswith("following"):
            self._hogs()

    def logging(self, folder): ...

    def step(self, record):
        self.records.append(record)


class NoLog:
    """Stands in for `TrialLog` where a trial without one is measured."""

    folder = Path("none")
    trouble = ""

    @classmethod
    def create(cls, *_, **__):
        return cls()

    def step(self, *_): ...

    def event(self, *_): ...

    def close(self, *_): ...


def measured(platform, minutes, hogs, scheduling):
    """Run trials for so many minutes beside `hogs`; return their ticks, by trial, and how they ended."""
    trials, endings = [], Counter()
    left_s, clock = minutes * 60, MonotonicClock()
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        plan = rehearsal(platform, folder, 1, target_speed_m_s=0.0, scheduling=scheduling)
        simulator = stack.enter_context(plan.platform.sitl(plan.profile))
        plan = replace(plan, profile=simulator.start(clock, plan.scenario), sitl=False)
        favour_robot()
        give_up_s = time.monotonic() + GIVE_UP * minutes * 60
        while left_s > 1 and time.monotonic() < give_up_s:
            plan = replace(plan, steps=round(left_s * RATE_HZ))
            try:
                with contextlib.ExitStack() as until:
                    recorder = Recorder(lambda until=until: until.enter_context(hogs()))
                    summary = run_trial(plan, recorder, time.monotonic())
            except PlatformError as error:
                endings[str(error)] += 1
                continue
            endings[summary["reason"] if summary["outcome"] != "completed" else "completed"] += 1
            if len(recorder.records) > 1:
                trials.append(recorder.records)
                left_s -= seconds_of(recorder.records)
    return trials, endings


def seconds_of(records):
    return (records[-1].t_ns - records[0].t_ns) / 1e9


def row(trials):
    """Return the figures of a row of the table, and what is wrong with them."""
    seconds = sum(map(seconds_of, trials))
    ticks = sum(len(records) - 1 for records in trials)
    missed = sum(records[-1].missed_deadlines for records in trials)
    began = [np.array([record.t_ns for record in records]) / 1e6 for records in trials]
    handed = [
        times
        + [record.latency.sensor_to_command_ms - record.latency.observation_age_ms for record in records]
        for times, records in zip(began, trials, strict=True)
    ]
    shortest, between_ticks = (min(np.diff(times).min() for times in series) for series in (handed, began))
    late = np.percentile([r.latency.lateness_ms for records in trials for r in records], (50, 99, 100))
    wire = [r.latency.sensor_to_wire_ms for records in trials for r in records]
    wire = np.percentile([ms for ms in wire if ms is not None], (50, 99))
    rate = ticks / seconds
    wrong = []
    if between_ticks < 500 / RATE_HZ:
        wrong.append("BURST")
    if abs((ticks + missed) / seconds / RATE_HZ - 1) > RATE_WITHIN:
        wrong.append("DRIFT")
    if abs(rate / RATE_HZ - 1) > RATE_WITHIN:
        wrong.append("rate")
    cells = (
        f"{seconds:.0f}",
        f"{len(trials)}",
        f"{rate:.3f}",
        f"{missed}",
        f"{shortest:.1f} ({between_ticks:.1f})",
        " / ".join(f"{ms:.2f}" for ms in late),
        " / ".join(f"{ms:.0f}" for ms in wire),
        ", ".join(wrong) or "ok",
    )
    return " | ".join(cells)


def main():
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=10.0, help="of each row (default: %(default)s)")
    parser.add_argument("--platform", default="wheeled")
    parser.add_argument("--hogs", type=int, nargs="+", default=[0, 4], help="busy processes beside it")
    parser.add_argument("--rest", type=float, default=0.0, metavar="MS", help="of the hogs, in every 100 ms")
    parser.add_argument("--log", choices=("yes", "no"), nargs="+", default=["yes", "no"])
    cores = parser.add_mutually_exclusive_group()
    cores.add_argument("--awake", action="store_true", help="keep cores awake, as --realtime does")
    cores.add_argument("--asleep", action="store_true", help="let them sleep in spite of --realtime")
    parser.add_argument("--realtime", action="store_true", help="SCHED_FIFO for loop and link")
    parser.add_argument("--cpu", metavar="LIST", help="cores for loop and link")
    options = parser.parse_args()
    cpus = read_cpus(options.cpu, os.sched_getaffinity(0)) if options.cpu else frozenset()
    scheduling = Scheduling(options.realtime, cpus)
    scheduling.check()
    if options.asleep:
        Scheduling.awake = lambda _: contextlib.nullcontext(enter_result=False)
    with Scheduling(options.realtime or options.awake).awake() as awake:
        told = f"{machine()}, {scheduling}, cores {'awake' if awake else 'may sleep'}"
        print(f"{options.platform}, {time.strftime('%Y-%m-%d')}, {told}", flush=True)
        print(HEAD)
        for hogs, log in itertools.product(options.hogs, options.log):
            without = patch("adatracker_deploy.app.trial_run.TrialLog", NoLog)
            beside, before_s = functools.partial(cpu_hogs, hogs, options.rest), stolen_s()
            with without if log == "no" else contextlib.nullcontext():
                trials, endings = measured(options.platform, options.minutes, beside, scheduling)
            figures = row(trials) if trials else "no trial began"
            print(f"{hogs:4d} | {log:3s} | {stolen_s() - before_s:.1f} | {figures}", flush=True)
            for ending, count in endings.most_common():
                print(f"           {count} x {ending}", flush=True)


if __name__ == "__main__":
    main()
