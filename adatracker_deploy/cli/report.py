"""``report``: one page to show, of a trial or a set of them."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from adatracker_deploy.report.gather import Report


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``report``."""
    parser = commands.add_parser(
        "report",
        help="make an HTML page of a trial, or of a set of trials",
        description="Make one self-contained HTML page: figures, pictures, curves, events and origin of a "
        "trial; points with intervals and survival curves of several.",
    )
    parser.add_argument(
        "trials",
        metavar="TRIAL",
        nargs="+",
        type=Path,
        help="a trial's folder or file, or a folder of trials",
    )
    parser.add_argument(
        "--out",
        metavar="HTML",
        type=Path,
        default=Path("report.html"),
        help="the page to write (default: %(default)s)",
    )
    parser.add_argument(
        "--all", action="store_true", help="include trials whose timing was not kept in the means"
    )
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object as the only line of stdout"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the page; return the exit status.

    Raises:
        UsageError: none of these is a trial, or the page cannot be written.
    """
    done = write_report(args.trials, args.out, everything=args.all)
    print(json.dumps(done) if args.json else args.out)
    return 0


def write_report(paths: Sequence[Path], out: Path, *, everything: bool = False) -> dict[str, Any]:
    """Write the page of the trials in and below `paths`; return what ``--json`` prints.

    Raises:
        UsageError: none of these is a trial, or the page cannot be written.
    """
    from adatracker_deploy.report.gather import moments
    from adatracker_deploy.report.set_page import set_page
    from adatracker_deploy.report.trial_page import trial_page

    reports = _read(paths)
    for report in reports:
        report.summary["counted"] |= everything
    one = reports[0] if len(reports) == 1 else None
    data = (trial_page(one, moments(one.trial)) if one else set_page(reports)).encode()
    try:
        out.write_bytes(data)
    except OSError as error:
        raise UsageError(f"--out {out}: cannot be written ({error.strerror})") from error
    return {"out": str(out), "trials": len(reports), "bytes": len(data)}


def _read(paths: Sequence[Path]) -> list[Report]:
    """Read every trial; a bad one costs a line on stderr, not the others."""
    from adatracker_deploy.report.gather import gather
    from adatracker_deploy.trial.reader import find_trials

    reports: list[Report] = []
    errors: list[UsageError] = []
    for path in paths:
        try:
            found = find_trials(path)
        except UsageError as error:
            errors.append(error)
            continue
        for trial in found:
            try:
                reports.append(gather(trial))
            except UsageError as error:
                errors.append(error)
    if not reports and len(errors) == 1:
        raise errors[0]
    for bad in errors:
        print(f"adatracker-deploy: left out: {bad}", file=sys.stderr)
    if not reports:
        raise UsageError("none of these could be read")
    return reports
