"""``trials``: which trials there are."""

from __future__ import annotations

import argparse
import csv
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from adatracker_deploy.scoring.index import Row


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``trials``."""
    parser = commands.add_parser(
        "trials",
        help="list trials: when, which robot and policy, how they ended",
        description="List the trials in and below a folder, the oldest first, with the operator's "
        "marks. A trial that cannot be read gets a line with the reason.",
    )
    parser.add_argument(
        "folder",
        metavar="FOLDER",
        nargs="?",
        type=Path,
        default=Path("trials"),
        help="(default: %(default)s)",
    )
    out = parser.add_mutually_exclusive_group()
    out.add_argument("--json", action="store_true", help="print one JSON object as the only line of stdout")
    out.add_argument(
        "--csv", action="store_true", help="print one line for each trial on stdout, for spreadsheets"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """List the trials; return the exit status.

    Raises:
        UsageError: there is no such folder, or no trial in it.
    """
    from adatracker_deploy.scoring.index import COLUMNS, index

    rows = index(args.folder)
    if args.json:
        print(json.dumps({"trials": rows}))
    elif args.csv:
        writer = csv.DictWriter(sys.stdout, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(row | {"notes": "; ".join(row["notes"])} for row in rows)
    else:
        print("\n".join(_lines(rows, args.folder)))
    return 0


def _lines(rows: Sequence[Row], folder: Path) -> Iterator[str]:
    """Give a line a trial, in columns as wide as they must be: no terminal's width cuts a name."""
    from adatracker_deploy.scoring.index import totals

    cells: list[tuple[str, ...]] = [
        ("began, UTC", "robot", "policy", "outcome", "MR", "EL", "s", "MB", "trial")
    ]
    cells += [_cells(row, folder) for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    for row, line in zip((None, *rows), cells, strict=True):
        fields = (
            cell.rjust(width) if place in _RIGHT else cell.ljust(width)
            for place, (cell, width) in enumerate(zip(line, widths, strict=True))
        )
        yield "  ".join(fields).rstrip()
        if row is not None:
            said = [*row["notes"], f"cannot be read: {row['error']}"] if row["error"] else row["notes"]
            yield from (f"    {_plain(text)}" for text in said)
    yield totals(rows)


_RIGHT = range(4, 8)


def _cells(row: Row, folder: Path) -> tuple[str, ...]:
    from adatracker_deploy.scoring.summary_table import number_text

    known = row["error"] is None
    return (
        _plain(row["started"] or "")[:19].replace("T", " "),
        f"{_plain(row['platform'])} ({_plain(row['kind'])})" if known else "",
        _plain(row["policy"]) if known else "",
        _ending(row) if known else "unreadable",
        number_text(row["mr"], 2),
        "-" if row["el"] is None else f"{row['el']}/{row['steps']}",
        number_text(row["seconds"], 1),
        number_text((row["bytes"] or 0) / 1e6, 1),
        str(Path(row["trial"]).relative_to(folder)),
    )


def _ending(row: Row) -> str:
    if row["outcome"] is None:
        return "being written"
    marked = row["outcome"] != row["recorded_outcome"]
    return f"{row['outcome']}{', marked' if marked else ''}{', late' if row['timing_kept'] is False else ''}"


def _plain(text: object) -> str:
    """Return a text without what would move a terminal's cursor or break its line."""
    return "".join(letter if letter.isprintable() else " " for letter in str(text))
