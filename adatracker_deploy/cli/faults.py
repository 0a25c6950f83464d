"""``faults``: every fault on every robot, in rehearsals, and whether each was stopped in time."""

from __future__ import annotations

import dataclasses
import itertools
import json
import signal
import sys
import tempfile
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from adatracker_deploy.cli.extras import need
from adatracker_deploy.cli.ranges import whole
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.faults.phases import ORDER, TrialPhase

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Sequence

    from adatracker_deploy.core.faults import Fault
    from adatracker_deploy.faults.judge import Result
    from adatracker_deploy.faults.sample import Cell
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


class Robot(NamedTuple):
    """A robot whose rehearsals can be measured."""

    name: str
    known: dict[str, Fault]
    """Its faults, by name."""
    flies: bool


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "faults",
        help="rehearse every fault on every robot, and check that each robot stops in time",
        description="Run a short rehearsal for each fault and robot, with real processes on real wires, and "
        "measure at the simulated robot when the last motion command came and when it stood. Exit status 1 "
        "if a limit was missed. A row that fails while the machine itself stalls is run again.",
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
        "--sample",
        action="store_true",
        help="of these, only what the everyday sample has: on every robot each phase and each fault of its "
        "own wire, and each other fault on one of them (default: every fault in every phase)",
    )
    parser.add_argument(
        "--at-once",
        type=whole(1, MOST_AT_ONCE),
        default=1,
        metavar="N",
        help="rehearsals side by side; a row that fails is run again beside half as many, and then alone "
        "(default: %(default)s)",
    )
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="also write the table into this file")
    parser.add_argument("--json", action="store_true", help="print one JSON object on stdout")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Rehearse the requested faults, show the results, and return 1 if a limit was missed."""
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
    console.print(f"rows that failed at their first try: {len(first)}")
    console.print(f"{len(jobs) - len(bad)} of {len(jobs)} rows passed" if jobs else "nothing to show")
    if args.json:
        print(json.dumps({"day": day, "faults": [dataclasses.asdict(result) for result in results]}))
    return 1 if bad else 0


def _jobs(args: argparse.Namespace) -> list[Job]:
    """Return what to run, robot by robot.

    Raises:
        UsageError: no such robot, no such fault, or the Markdown file has no place for the table.
    """
    from adatracker_deploy.faults.matrix import REFUSALS, TIMING
    from adatracker_deploy.faults.refusals import refuse
    from adatracker_deploy.faults.rehearse import rehearse
    from adatracker_deploy.faults.table import check_section

    wanted = _wanted(args)
    refusals = [refusal for refusal in REFUSALS if wanted(refusal.name, refusal.name, None)]
    if args.markdown is not None:
        check_section(args.markdown)
    jobs: list[Job] = []
    sample = _sample() if args.sample else None
    for robot in _robots(args.platform):
        jobs += [
            Job(
                partial(rehearse, cell.row, robot.name, robot.known[cell.row.fault].says),
                cell.row.measure in TIMING,
            )
            for cell in _cells(robot)
            if wanted(cell.row.fault, cell.row.name, cell.row.phase)
            and (sample is None or (cell.platform, cell.row.name) in sample)
        ]
        jobs += [Job(partial(refuse, refusal, robot.name)) for refusal in refusals]
    return jobs


def _sample() -> set[tuple[str, str]]:
    """Return robot and name of each row of the sample of all robots, whichever of them were asked for."""
    from adatracker_deploy.faults.sample import sampled

    cells = [cell for robot in _robots(None) for cell in _cells(robot)]
    return {(cell.platform, cell.row.name) for cell in sampled(cells)}


def _cells(robot: Robot) -> list[Cell]:
    """Return the rows of one robot."""
    from adatracker_deploy.faults.phase_rows import all_rows
    from adatracker_deploy.faults.sample import Cell

    rows = all_rows(robot.name, flies=robot.flies)
    return [Cell(robot.name, row, robot.flies) for row in rows if row.fault in robot.known]


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
    for platform, known, flies in _robots(args.platform):
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


def _robots(asked: Sequence[str] | None) -> list[Robot]:
    """Return each robot that was asked for, or can be measured.

    Raises:
        UsageError: there is no such robot, or its simulator takes no commands, such as to record ground
            truth.
    """
    from adatracker_deploy.core.faults import known_faults
    from adatracker_deploy.platform import Sitl
    from adatracker_deploy.registry import load_platform, load_profile, platform_names

    robots = []
    for name in asked or platform_names():
        try:
            need([name], f"platform {name}")
        except UsageError as error:
            if asked:
                raise
            print(f"left out: {error}", file=sys.stderr)
            continue
        platform = load_platform(name)
        simulator = platform.sitl(load_profile(platform.default_profile, platform))
        if type(simulator).order is not Sitl.order:
            robots.append(Robot(name, known_faults(simulator.faults), "vz" in platform.axes))
        elif asked:
            raise UsageError(f"platform {name}: its simulator takes no commands, so nothing can be measured")
    return robots


def _run_all(
    jobs: Sequence[Job], at_once: int, stalls: StallMonitor, tell: Callable[[Result], None]
) -> list[Result]:
    """Run all rows, several side by side; then alone those that must be, or went wrong beside another.

    Those that went wrong are run again beside half as many first: most of them only lacked a core.
    """
    results: dict[int, Result] = {}
    failed: dict[int, Result] = {}
    ending = threading.Event()

    def rehearse_one(at: int) -> None:
        if ending.is_set():
            return
        result = replace(_once(jobs[at], stalls), first_failure=_first(failed.get(at)))
        if result.verdict == "ok":
            results[at] = result
            tell(result)
        else:
            failed.setdefault(at, result)

    while at_once > 1:
        left = [at for at, job in enumerate(jobs) if not job.alone and at not in results]
        with ThreadPoolExecutor(at_once) as pool:
            beside = [pool.submit(rehearse_one, at) for at in left]
            try:
                for one in beside:
                    one.result()
            except BaseException:
                ending.set()
                raise
        at_once //= 2
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
    first = _first(before)
    for tries in range(1, TRIES + 1):
        result = replace(_once(job, stalls), tries=tries, first_failure=first)
        if result.verdict == "ok" or not (job.alone or result.stall_s >= STALLED_S):
            break
        first = first or _told(result)
    return result


def _first(beside: Result | None) -> str:
    """Return how a row first went wrong beside others; empty if it did not."""
    return "" if beside is None else f"beside others, {_told(beside)}"


def _told(result: Result) -> str:
    value = "" if result.value_s is None else f" {result.value_s:.2f}"
    stall = f", machine stalled {result.stall_s:.2f} s"
    return f"{result.verdict}{value} (limit {result.limit}){stall}{': ' if result.note else ''}{result.note}"
