"""``faults``: every fault on every robot, in rehearsals, and whether each was stopped in time."""

from __future__ import annotations

import dataclasses
import itertools
import json
import tempfile
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from adatracker_deploy.cli.ranges import whole
from adatracker_deploy.errors import UsageError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Sequence

    from adatracker_deploy.faults.catalogue import Fault
    from adatracker_deploy.faults.judge import Result
    from adatracker_deploy.faults.stalls import Stalls

TRIES = 3
STALLED_S = 0.03
"""A machine that stood still for so long explains a row that went wrong, and it is run again."""
MOST_AT_ONCE = 8


class Job(NamedTuple):
    """A row, still to be run."""

    run: Callable[[Stalls, Path], Result]
    """In an empty folder."""
    platform: str
    """Two rows of one robot, whose ports may be its profile's, never run at once."""
    alone: bool = False
    """Nor with any other: it is one of timing."""


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
        "--fault", action="extend", nargs="+", metavar="NAME", help="these faults (default: all)"
    )
    parser.add_argument(
        "--at-once",
        type=whole(1, MOST_AT_ONCE),
        default=1,
        metavar="N",
        help="robots to rehearse side by side; a row that goes wrong so is run again alone, and that counts "
        "(default: %(default)s)",
    )
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the table into this file too")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Rehearse what was asked for, show it, and return 1 if a limit was missed."""
    from rich.console import Console

    from adatracker_deploy.faults.stalls import Stalls
    from adatracker_deploy.faults.table import results_table, write_markdown

    jobs = _jobs(args)
    console = Console(stderr=args.json)
    told = itertools.count(1)

    def tell(result: Result) -> None:
        time_s = "-" if result.told_s is None else f"{result.told_s:.2f} s"
        again = f", try {result.tries}" if result.tries > 1 else ""
        console.print(
            f"{next(told)}/{len(jobs)} {result.platform} {result.fault}: {result.verdict}, {time_s}, machine "
            f"stalled {result.stall_s:.2f} s{again} {result.note}".rstrip(),
            markup=False,
            soft_wrap=True,
        )

    day = datetime.now(UTC).date().isoformat()
    with Stalls() as stalls:
        results = _run_all(jobs, args.at_once, stalls, tell)
    results += _absent(args)
    console.print(results_table(results))
    if args.markdown is not None:
        write_markdown(args.markdown, results, day)
    bad = [result for result in results if result.verdict in ("LATE", "WRONG")]
    console.print(f"{len(jobs) - len(bad)} of {len(jobs)} as they should be" if jobs else "nothing to show")
    if args.json:
        print(json.dumps({"day": day, "faults": [dataclasses.asdict(result) for result in results]}))
    return 1 if bad else 0


def _jobs(args: argparse.Namespace) -> list[Job]:
    """Return what to run, robot by robot.

    Raises:
        UsageError: no such robot, no such fault, or the Markdown file has no place for the table.
    """
    from adatracker_deploy.faults.matrix import REFUSALS, ROWS, TIMING
    from adatracker_deploy.faults.refusals import refuse
    from adatracker_deploy.faults.rehearse import rehearse
    from adatracker_deploy.faults.table import check_section

    names = [*(row.fault for row in ROWS), *(refusal.name for refusal in REFUSALS)]
    for name in args.fault or ():
        if name not in names:
            raise UsageError(f"--fault {name}: unknown to the matrix; known are {', '.join(sorted(names))}")
    if args.markdown is not None:
        check_section(args.markdown)
    wanted = args.fault or names
    jobs: list[Job] = []
    for platform, known in _robots(args):
        jobs += [
            Job(partial(rehearse, row, platform, known[row.fault].says), platform, row.measure in TIMING)
            for row in ROWS
            if row.fault in wanted and row.fault in known
        ]
        jobs += [
            Job(partial(refuse, refusal, platform), platform)
            for refusal in REFUSALS
            if refusal.name in wanted
        ]
    return jobs


def _absent(args: argparse.Namespace) -> list[Result]:
    """Return a row for each fault that a robot cannot suffer, though another can."""
    from adatracker_deploy.faults.judge import Result
    from adatracker_deploy.faults.matrix import ROWS, absent

    return [
        Result(platform=platform, fault=row.fault, says="", limit="", note=absent(platform, row.fault))
        for platform, known in _robots(args)
        for row in ROWS
        if row.fault in (args.fault or [row.fault]) and row.fault not in known
    ]


def _robots(args: argparse.Namespace) -> list[tuple[str, dict[str, Fault]]]:
    """Return each robot that was asked for, or every one that can be measured, and what it can suffer.

    Raises:
        UsageError: there is no such robot, or its far end takes no orders, to have a witness above all.
    """
    from adatracker_deploy.faults.catalogue import known_faults
    from adatracker_deploy.platform import Sitl, load_platform, platform_names
    from adatracker_deploy.profile import load_profile

    robots = []
    for name in args.platform or platform_names():
        platform = load_platform(name)
        far_end = platform.sitl(load_profile(platform.default_profile, platform))
        if type(far_end).order is not Sitl.order:
            robots.append((name, known_faults(far_end.faults)))
        elif args.platform:
            raise UsageError(
                f"platform {name}: its far end takes no orders, so nothing can be measured at it"
            )
    return robots


def _run_all(
    jobs: Sequence[Job], at_once: int, stalls: Stalls, tell: Callable[[Result], None]
) -> list[Result]:
    """Run all rows, robots side by side; then alone those that must be, or went wrong beside another."""
    results: dict[int, Result] = {}
    ending = threading.Event()

    def rehearse_one(platform: str) -> None:
        for at, job in enumerate(jobs):
            if job.platform != platform or job.alone or ending.is_set():
                continue
            result = _once(job, stalls)
            if result.verdict == "ok":
                results[at] = result
                tell(result)

    if at_once > 1:
        with ThreadPoolExecutor(at_once) as pool:
            robots = [pool.submit(rehearse_one, name) for name in dict.fromkeys(job.platform for job in jobs)]
            try:
                for robot in robots:
                    robot.result()
            finally:
                ending.set()
    for at, job in enumerate(jobs):
        if at not in results:
            results[at] = _until_calm(job, stalls)
            tell(results[at])
    return [results[at] for at in range(len(jobs))]


def _once(job: Job, stalls: Stalls) -> Result:
    with tempfile.TemporaryDirectory(prefix="faults-") as folder:
        return job.run(stalls, Path(folder))


def _until_calm(job: Job, stalls: Stalls) -> Result:
    """Run a row, and once or twice more where the machine stood still while it went wrong.

    A row of timing is run again in any case: a robot that waits for a core, which no stall shows, is late
    once, and what is wrong with a gate is wrong each time.
    """
    for tries in range(1, TRIES + 1):
        result = replace(_once(job, stalls), tries=tries)
        if result.verdict == "ok" or not (job.alone or result.stall_s >= STALLED_S):
            break
    return result
