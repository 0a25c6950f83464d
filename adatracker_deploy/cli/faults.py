"""``faults``: every fault on every robot, in rehearsals, and whether each was stopped in time."""

from __future__ import annotations

import dataclasses
import itertools
import json
import signal
import tempfile
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from adatracker_deploy.cli.ranges import whole
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.faults.phases import ORDER, TrialPhase

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Sequence

    from adatracker_deploy.core.faults import Fault
    from adatracker_deploy.faults.judge import Result
    from adatracker_deploy.faults.stalls import StallMonitor

TRIES = 3
STALLED_S = 0.03
"""A machine that stood still for so long explains a row that went wrong, and it is run again."""
MOST_AT_ONCE = 8


class Job(NamedTuple):
    """A row, still to be run."""

    run: Callable[[StallMonitor, Path], Result]
    """In an empty folder."""
    alone: bool = False
    """Never beside another: it is one of timing."""


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "faults",
        help="rehearse every fault on every robot, and see that each is stopped in time",
        description="Runs a short rehearsal for each fault and robot, with real processes on real wires, and "
        "measures at the simulated robot when it was last told to move and when it stood. Exit status 1 if a "
        "limit was missed. A row that goes wrong while the machine itself stands still is run again.",
    )
    parser.add_argument(
        "--platform", action="extend", nargs="+", metavar="NAME", help="these robots (default: all)"
    )
    parser.add_argument(
        "--fault",
        action="extend",
        nargs="+",
        metavar="NAME",
        help="these faults, in every phase, or NAME@PHASE (default: all)",
    )
    parser.add_argument(
        "--phase",
        action="extend",
        nargs="+",
        choices=[*map(str, ORDER)],
        metavar="PHASE",
        help=f"these phases of a trial: {', '.join(ORDER)} (default: all)",
    )
    parser.add_argument(
        "--at-once",
        type=whole(1, MOST_AT_ONCE),
        default=1,
        metavar="N",
        help="rehearsals side by side; a row that goes wrong so is run again alone, and that counts "
        "(default: %(default)s)",
    )
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the table into this file too")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Rehearse what was asked for, show it, and return 1 if a limit was missed."""
    from rich.console import Console

    from adatracker_deploy.faults.stalls import StallMonitor
    from adatracker_deploy.faults.table import results_table, write_markdown

    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:  # under nohup: trials would ignore hangups, too
        signal.signal(signal.SIGHUP, lambda *_: None)
    jobs = _jobs(args)
    console = Console(stderr=args.json)
    told = itertools.count(1)

    def tell(result: Result) -> None:
        time_s = "-" if result.value_s is None else f"{result.value_s:.2f}"
        again = f", try {result.tries}" if result.tries > 1 else ""
        console.print(
            f"{next(told)}/{len(jobs)} {result.platform} {result.name}: {result.verdict}, {time_s}, machine "
            f"stalled {result.stall_s:.2f} s{again} {result.note}".rstrip(),
            markup=False,
            soft_wrap=True,
        )

    day = datetime.now(UTC).date().isoformat()
    with StallMonitor() as stalls:
        results = _run_all(jobs, args.at_once, stalls, tell)
    results += _absent(args)
    console.print(results_table(results))
    if args.markdown is not None:
        write_markdown(args.markdown, results, day)
    bad = [result for result in results if result.verdict in ("LATE", "WRONG")]
    first = [result for result in results if result.first_failure]
    for result in first:
        console.print(f"first try of {result.platform} {result.name}: {result.first_failure}", markup=False)
    console.print(f"rows that were not as they should be at their first try: {len(first)}")
    console.print(f"{len(jobs) - len(bad)} of {len(jobs)} as they should be" if jobs else "nothing to show")
    if args.json:
        print(json.dumps({"day": day, "faults": [dataclasses.asdict(result) for result in results]}))
    return 1 if bad else 0


def _jobs(args: argparse.Namespace) -> list[Job]:
    """Return what to run, robot by robot.

    Raises:
        UsageError: no such robot, no such fault, or the Markdown file has no place for the table.
    """
    from adatracker_deploy.faults.matrix import REFUSALS, TIMING
    from adatracker_deploy.faults.phase_rows import all_rows
    from adatracker_deploy.faults.refusals import refuse
    from adatracker_deploy.faults.rehearse import rehearse
    from adatracker_deploy.faults.table import check_section

    wanted = _wanted(args)
    refusals = [refusal for refusal in REFUSALS if wanted(refusal.name, refusal.name, None)]
    if args.markdown is not None:
        check_section(args.markdown)
    jobs: list[Job] = []
    for platform, known, flies in _robots(args):
        jobs += [
            Job(partial(rehearse, row, platform, known[row.fault].says), row.measure in TIMING)
            for row in all_rows(platform, flies=flies)
            if row.fault in known and wanted(row.fault, row.name, row.phase)
        ]
        jobs += [Job(partial(refuse, refusal, platform)) for refusal in refusals]
    return jobs


def _wanted(args: argparse.Namespace) -> Callable[[str, str, TrialPhase | None], bool]:
    """Return what tells whether a row was asked for, by its fault, its own name and its phase.

    Raises:
        UsageError: no row bears a name that was asked for.
    """
    from adatracker_deploy.faults.matrix import REFUSALS, ROWS
    from adatracker_deploy.faults.phase_rows import PHASE_ROWS

    rows = (*ROWS, *PHASE_ROWS)
    names = {*(row.fault for row in rows), *(row.name for row in rows), *(one.name for one in REFUSALS)}
    for name in args.fault or ():
        if name not in names:
            faults = sorted(name for name in names if "@" not in name)
            raise UsageError(f"--fault {name}: unknown to the matrix; known are {', '.join(faults)}")

    def wanted(fault: str, name: str, phase: TrialPhase | None) -> bool:
        named = not args.fault or fault in args.fault or name in args.fault
        return named and (not args.phase or phase in args.phase)

    return wanted


def _absent(args: argparse.Namespace) -> list[Result]:
    """Return a result for each cell that a robot has no row for, though another has, or may have."""
    from adatracker_deploy.faults.judge import Result
    from adatracker_deploy.faults.matrix import ROWS, absent
    from adatracker_deploy.faults.phase_rows import PHASE_FAULTS, absent_in_phase, has_phase

    wanted, results = _wanted(args), []
    for platform, known, flies in _robots(args):
        cells = [(row.fault, TrialPhase.FOLLOWING) for row in ROWS]
        cells += [
            (fault, phase) for phase in ORDER for fault in PHASE_FAULTS if phase != TrialPhase.FOLLOWING
        ]
        for fault, phase in cells:
            name = fault if phase == TrialPhase.FOLLOWING else f"{fault}@{phase}"
            why = (
                absent_in_phase(platform, fault, phase, flies=flies) if phase != TrialPhase.FOLLOWING else ""
            )
            if fault not in known and has_phase(phase, flies=flies):
                why = absent(platform, fault)
            if why and wanted(fault, name, phase):
                results.append(
                    Result(platform=platform, fault=fault, phase=phase, says="", limit="", note=why)
                )
    return results


def _robots(args: argparse.Namespace) -> list[tuple[str, dict[str, Fault], bool]]:
    """Return each robot that was asked for, or can be measured, what it can suffer, and whether it flies.

    Raises:
        UsageError: there is no such robot, or its simulator takes no commands, such as to record ground
            truth.
    """
    from adatracker_deploy.core.faults import known_faults
    from adatracker_deploy.platform import Sitl
    from adatracker_deploy.registry import load_platform, load_profile, platform_names

    robots = []
    for name in args.platform or platform_names():
        platform = load_platform(name)
        simulator = platform.sitl(load_profile(platform.default_profile, platform))
        if type(simulator).order is not Sitl.order:
            robots.append((name, known_faults(simulator.faults), "vz" in platform.axes))
        elif args.platform:
            raise UsageError(
                f"platform {name}: its simulator takes no orders, so nothing can be measured at it"
            )
    return robots


def _run_all(
    jobs: Sequence[Job], at_once: int, stalls: StallMonitor, tell: Callable[[Result], None]
) -> list[Result]:
    """Run all rows, several side by side; then alone those that must be, or went wrong beside another."""
    results: dict[int, Result] = {}
    failed: dict[int, Result] = {}
    ending = threading.Event()

    def rehearse_one(at: int) -> None:
        if ending.is_set():
            return
        result = _once(jobs[at], stalls)
        if result.verdict == "ok":
            results[at] = result
            tell(result)
        else:
            failed[at] = result

    if at_once > 1:
        with ThreadPoolExecutor(at_once) as pool:
            beside = [pool.submit(rehearse_one, at) for at, job in enumerate(jobs) if not job.alone]
            try:
                for one in beside:
                    one.result()
            finally:
                ending.set()
    for at, job in enumerate(jobs):
        if at not in results:
            results[at] = _until_calm(job, stalls, failed.get(at))
            tell(results[at])
    return [results[at] for at in range(len(jobs))]


def _once(job: Job, stalls: StallMonitor) -> Result:
    with tempfile.TemporaryDirectory(prefix="faults-") as folder:
        return job.run(stalls, Path(folder))


def _until_calm(job: Job, stalls: StallMonitor, before: Result | None = None) -> Result:
    """Run a row, and once or twice more where the machine stood still while it went wrong.

    A row of timing is run again in any case: a robot that waits for a core, which no stall shows, is late
    once, and what is wrong with a gate is wrong each time. How it first went wrong stays with the result.

    Args:
        job: the row.
        stalls: watches the machine.
        before: how it went wrong beside others.
    """
    first = "" if before is None else f"beside others, {_told(before)}"
    for tries in range(1, TRIES + 1):
        result = replace(_once(job, stalls), tries=tries, first_failure=first)
        if result.verdict == "ok" or not (job.alone or result.stall_s >= STALLED_S):
            break
        first = first or _told(result)
    return result


def _told(result: Result) -> str:
    value = "" if result.value_s is None else f" {result.value_s:.2f}"
    stall = f", machine stalled {result.stall_s:.2f} s"
    return f"{result.verdict}{value} (limit {result.limit}){stall}{': ' if result.note else ''}{result.note}"
