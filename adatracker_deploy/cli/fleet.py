"""``adatracker-deploy --fleet FILE``: several robots at once, one stop for all, one report."""

from __future__ import annotations

import argparse
import contextlib
import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adatracker_deploy.cli.ranges import whole
from adatracker_deploy.config.fleet import OF_THE_COMMAND
from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rich.console import Console

    from adatracker_deploy.app.fleet_run import Ended
    from adatracker_deploy.config.fleet import Fleet, Kind

REPORT_NAME = "report.html"
_NO_ROBOTS = frozenset({"help", "version", "fleet", "name", "ask", "simulator", "together"})
"""The command's options that no robot of a fleet has, beside those for all."""
_STYLES = ("cyan", "magenta", "green", "yellow", "blue", "red")


def parse(argv: Sequence[str]) -> argparse.Namespace:
    """Return the arguments of a fleet's command line.

    Raises:
        UsageError: they are wrong, or belong in the file.
    """
    from adatracker_deploy.cli import _Parser

    parser = _Parser(
        prog="adatracker-deploy",
        usage="%(prog)s --fleet FILE [--sitl | --dry-run] [--log-dir DIR] [--stop-fd N] [--json]",
        description="Run several robots at once: each with its own link, camera, policy and log, one stop "
        "for all, one report (docs/fleet.md).",
        allow_abbrev=False,
    )
    parser.add_argument("--fleet", type=Path, required=True, metavar="FILE", help="robots and their options")
    moves = parser.add_mutually_exclusive_group()
    moves.add_argument("--sitl", action="store_true", help="rehearse: every robot is simulated")
    moves.add_argument("--dry-run", action="store_true", help="no robot is connected: nothing moves")
    parser.add_argument(
        "--log-dir", type=Path, default=Path("trials"), help="folder of the logs (default: %(default)s)"
    )
    parser.add_argument(
        "--stop-fd",
        type=whole(0, 65535),
        metavar="N",
        help="stop all robots when this file descriptor becomes readable or is closed",
    )
    parser.add_argument(
        "--on-hangup",
        choices=("stop", "continue"),
        default="stop",
        help="if the terminal is lost: stop all robots in order (default), or continue",
    )
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object as the last line of stdout"
    )
    parser.set_defaults(run=run)
    args, rest = parser.parse_known_args(argv)
    if rest:
        raise UsageError(f"{rest[0]} goes into {args.fleet}: under common, or under a robot")
    return args


def run(args: argparse.Namespace) -> int:
    """Run the fleet, show its scores, write its report, and return the worst exit status.

    Raises:
        UsageError: the file or a robot's request is wrong; nothing has moved.
    """
    from rich.console import Console

    from adatracker_deploy.app.fleet_run import FleetRun
    from adatracker_deploy.app.fleet_steps import INTERRUPTED, worst
    from adatracker_deploy.config.fleet import parse_fleet
    from adatracker_deploy.config.yaml_text import read_yaml
    from adatracker_deploy.runtime.lost_terminal import tolerated
    from adatracker_deploy.runtime.operator_stop import StopRequest, heard
    from adatracker_deploy.runtime.running import Announcement
    from adatracker_deploy.trial.folder import new_folder, place_for_logs
    from adatracker_deploy.trial.salvage import salvage_all

    where = str(args.fleet)
    fleet = parse_fleet(read_yaml(args.fleet), known_options(), where=where)
    _check(fleet, where, real=not (args.sitl or args.dry_run))
    place_for_logs(args.log_dir)
    console = Console(stderr=args.json)
    for line in salvage_all(args.log_dir):
        console.print(line, markup=False, soft_wrap=True)
    tell = _Teller(console, [robot.name for robot in fleet.robots])
    kind = "sitl" if args.sitl else "dry" if args.dry_run else "real"
    robots = {robot.name: (*robot.arguments, *_of_all(args)) for robot in fleet.robots}
    with contextlib.closing(Announcement("fleet")) as announcement, tolerated():
        stop = StopRequest(announcement.stopping, outlives_terminal=args.on_hangup == "continue")
        with (
            stop.listening(),
            stop.trial(),
            heard(args.stop_fd, outlives_terminal=stop.outlives_terminal) as enter,
        ):
            folder = new_folder(args.log_dir, time.time_ns(), f"fleet_{kind}")
            announcement.logging(folder)
            with FleetRun(robots, folder, fleet.on_failure, tell) as under_way:
                if enter:
                    tell("", "Enter or Ctrl-C stops all robots")
                try:
                    under_way.run(stop.insist)
                except KeyboardInterrupt:
                    with stop.finishing():
                        tell("", "stopped by the operator: all stop")
                        under_way.stop()
                except UsageError as error:
                    under_way.forget(folder)
                    raise UsageError(f"{where}: robots: {error}") from None
                ended = under_way.ended()
    _show(ended, console)
    report = _report(folder, console)
    status = worst([*(one.status for one in ended), *([INTERRUPTED] if stop.asked else ())])
    if args.json:
        print(json.dumps(_record(folder, report, ended)))
    return status


def known_options() -> dict[str, Kind]:
    """Return the options that a robot of a fleet may have, and what each takes: the command's own."""
    from adatracker_deploy.cli import _parser

    known: dict[str, Kind] = {}
    for action in _parser(with_commands=False)._actions:  # argparse has no other way to its arguments
        option = action.option_strings[-1].removeprefix("--")
        if option.removeprefix("no-") in _NO_ROBOTS | OF_THE_COMMAND:
            continue
        known[option] = (
            "list"
            if isinstance(action, argparse._AppendAction)
            else "flag"
            if action.nargs == 0
            else "either"
            if action.nargs == "?"
            else "value"
        )
    return known


def _of_all(args: argparse.Namespace) -> tuple[str, ...]:
    moves = ("--sitl",) if args.sitl else ("--dry-run",) if args.dry_run else ()
    return (*moves, "--on-hangup", args.on_hangup)


def _check(fleet: Fleet, where: str, *, real: bool) -> None:
    """Check what can be checked without opening anything; each robot's run checks the rest before the start.

    Raises:
        UsageError: an option is wrong, or two robots share what only one can have.
    """
    from adatracker_deploy.cli import _parser
    from adatracker_deploy.config.fleet import first_shared
    from adatracker_deploy.registry import load_platform, load_profile
    from adatracker_deploy.runtime.teleop.open_hand import KEYBOARD

    parser = _parser(with_commands=False)
    identities, ports, pages, hands = {}, {}, {}, {}
    for robot in fleet.robots:
        try:
            asked = parser.parse_args(robot.arguments)
            platform = load_platform(asked.platform)
            profile = load_profile(asked.profile or platform.default_profile, platform)
            if asked.teleop == KEYBOARD:
                raise UsageError("--teleop keyboard: a fleet has no keyboard of its own; give a gamepad")
        except UsageError as error:
            raise UsageError(f"{where}: robots: {robot.name}: {error}") from None
        identities[robot.name] = platform.identity(profile) if real else None
        ports[robot.name] = str(asked.live) if asked.live else None
        pages[robot.name] = str(asked.page) if asked.page else None
        hands[robot.name] = asked.teleop
    for values, what in (
        (identities, "reach the same robot, {}: give each a profile of its own"),
        (ports, "have the same live port, {}: give each its own, or 0 for any"),
        (pages, "have their page at the same port, {}: give each its own, or 0 for any"),
        (hands, "are driven by the same hand, {}: give each its own"),
    ):
        shared = first_shared(values)
        if shared is not None:
            said = what.format(values[shared[0]])
            raise UsageError(f"{where}: robots: {shared[0]} and {shared[1]} {said}")


class _Teller:
    """Shows what the robots say, each line after its robot's name."""

    def __init__(self, console: Console, names: Sequence[str]) -> None:
        self._console = console
        self._width = max(map(len, names))
        self._styles = {name: _STYLES[place % len(_STYLES)] for place, name in enumerate(names)}

    def __call__(self, name: str, line: str) -> None:
        from rich.text import Text

        head = Text(f"{name or 'fleet':>{self._width}} | ", self._styles.get(name, "bold"))
        with contextlib.suppress(OSError, SystemExit):  # rich exits when a pipe is closed
            self._console.print(head + Text(line), soft_wrap=True)


def _show(ended: Sequence[Ended], console: Console) -> None:
    from adatracker_deploy.scoring.summary_table import summary_table

    summaries = [summary for one in ended for summary in one.summaries]
    if summaries:
        console.print(summary_table(summaries))
    for one in ended:
        outcomes = ", ".join(summary["outcome"] for summary in one.summaries) or "no trial"
        words = f"  {one.name}: {outcomes}; exit status {one.status}"
        console.print(words, markup=False, highlight=False, soft_wrap=True)


def _report(folder: Path, console: Console) -> Path | None:
    """Write one page of the fleet's trials; return its path, or None where there is none."""
    from adatracker_deploy.cli.report import write_report

    out = folder / REPORT_NAME
    try:
        write_report([folder], out)
    except UsageError as error:
        console.print(f"no report: {error}", markup=False, soft_wrap=True)
        return None
    console.print(f"report: {out}", markup=False, highlight=False, soft_wrap=True)
    return out


def _record(folder: Path, report: Path | None, ended: Sequence[Ended]) -> Mapping[str, Any]:
    return {
        "fleet": str(folder),
        "report": None if report is None else str(report),
        "robots": {one.name: {"status": one.status, "result": one.result} for one in ended},
    }
