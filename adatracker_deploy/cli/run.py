"""The run itself: ``adatracker-deploy --platform NAME [--sitl] ...``."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adatracker_deploy.cli.driving import add_policy_options
from adatracker_deploy.cli.planning import plans_of
from adatracker_deploy.cli.ranges import real, whole
from adatracker_deploy.cli.seeing import add_provider_option, add_segmenter_options
from adatracker_deploy.page.address import DEFAULT_PORT as PAGE_PORT
from adatracker_deploy.trial.live_port import DEFAULT_PORT

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import Console

    from adatracker_deploy.app.trial_plan import TrialPlan
    from adatracker_deploy.runtime.operator_stop import StopRequest
    from adatracker_deploy.runtime.running import Announcement


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the run's options to the command itself."""
    what = parser.add_argument_group("what to run")
    what.add_argument(
        "--platform",
        metavar="NAME",
        help="the robot: see 'adatracker-deploy platforms'; with --sitl also several: NAME,NAME,...",
    )
    what.add_argument(
        "--sitl",
        action="store_true",
        help="rehearse: a simulator stands in for the robot, behind the robot's real wire",
    )
    what.add_argument(
        "--dry-run", action="store_true", help="run everything with no robot connected: nothing moves"
    )
    what.add_argument("--profile", metavar="NAME|FILE", help="the robot's profile (default: the platform's)")
    what.add_argument("--name", default="", help="the robot's name: in its log, and for 'stop NAME'")
    what.add_argument(
        "--fleet",
        type=Path,
        metavar="FILE",
        help="several robots at once, each with options of its own, from this file (docs/fleet.md)",
    )
    add_policy_options(what)
    how = parser.add_argument_group("how")
    how.add_argument(
        "--steps",
        type=whole(1, 1_000_000),
        default=600,
        help="length of a trial in ticks (default: %(default)s)",
    )
    how.add_argument(
        "--trials",
        type=whole(1, 1000),
        default=1,
        help="number of trials, with seeds from --seed up (default: 1)",
    )
    how.add_argument(
        "--seed",
        type=whole(0, 2**31 - 1),
        default=0,
        help="seed of the world and the simulation (default: 0)",
    )
    how.add_argument(
        "--speed-cap",
        type=real(0.01, 1),
        default=1.0,
        metavar="SHARE",
        help="share of the profile's speeds, turning too: 0.25 for a real robot's first drive (default: 1)",
    )
    how.add_argument(
        "--ask",
        action=argparse.BooleanOptionalAction,
        help="ask after each trial how it ended, and before the next whether to begin (default: with several "
        "trials on a real robot, in a terminal)",
    )
    how.add_argument(
        "--stop-fd",
        type=whole(0, 65535),
        metavar="N",
        help="stop when this file descriptor becomes readable or is closed: for buttons and other hooks",
    )
    how.add_argument(
        "--on-hangup",
        choices=("stop", "continue"),
        default="stop",
        help="if the terminal is lost, as when SSH drops: stop the robot in order (default), or continue",
    )
    how.add_argument(
        "--speed",
        type=real(1, 20),
        help="times real time, 1 to 20, --sitl only; above 2 segmenters fall behind: add --segmenter truth",
    )
    how.add_argument(
        "--realtime",
        action="store_true",
        help="real-time priority (SCHED_FIFO) for the loop and the link; the system must allow it",
    )
    how.add_argument("--cpu", metavar="LIST", help="cores for the loop and the link: 2, or 0,2-3")
    how.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="NAME@WHEN,...",
        help="with --sitl: inject this fault so many seconds after the first followed tick, or in a phase "
        "of the trial: PHASE, PHASE+SECONDS (docs/safety.md)",
    )
    how.add_argument("--simulator", type=Path, help=argparse.SUPPRESS)  # the fault matrix's, still running
    how.add_argument("--together", type=whole(0, 65535), help=argparse.SUPPRESS)  # a fleet's start line
    view = parser.add_argument_group("what it sees")
    view.add_argument(
        "--camera",
        metavar="URI",
        help="world://SCENE: a virtual world, also for a real robot; robot://TOPIC: the robot's own wire; "
        "or a device's number, a file, a folder of pictures, an http, rtsp or gst address",
    )
    view.add_argument("--scene", metavar="NAME", help="the virtual world (default: simple_room)")
    view.add_argument(
        "--target-speed",
        type=real(0, 5),
        default=1.0,
        metavar="M_S",
        help="speed of the virtual person, m/s (default: 1.0)",
    )
    view.add_argument(
        "--others",
        type=whole(0, 20),
        default=0,
        metavar="N",
        help="virtual people besides the target (default: 0)",
    )
    view.add_argument(
        "--person", type=Path, metavar="GLB", help="figure of the virtual person to follow, as glTF"
    )
    view.add_argument(
        "--effects",
        metavar="LIST",
        help="what makes the virtual world harder to see in, as in fog=40,road=C,sit: fog of this optical "
        "range, m; a road of ISO 8608 that shakes a driving body; people who sit down at times",
    )
    add_segmenter_options(
        view,
        default="embedded; in a virtual world also truth, and noisy: truth with the embedded one's mistakes",
    )
    add_provider_option(view)
    out = parser.add_argument_group("what it records")
    out.add_argument(
        "--log-dir", type=Path, default=Path("trials"), help="folder of the logs (default: %(default)s)"
    )
    out.add_argument(
        "--live",
        type=whole(0, 65535),
        nargs="?",
        const=DEFAULT_PORT,
        metavar="PORT",
        help="show the trial in Foxglove: a websocket on this machine, at PORT (%(const)s; 0: any free one)",
    )
    out.add_argument(
        "--page",
        type=whole(0, 65535),
        nargs="?",
        const=PAGE_PORT,
        metavar="PORT",
        help="serve a page to watch, stop and choose the target by a click: on this machine, at PORT "
        "(%(const)s; 0: any free one)",
    )
    kept = out.add_mutually_exclusive_group()
    kept.add_argument(
        "--blur",
        action="store_const",
        dest="frames",
        const="blurred",
        default="full",
        help="in the pictures of log and live view, blur every detected person but the target",
    )
    kept.add_argument(
        "--no-frames",
        action="store_const",
        dest="frames",
        const="none",
        help="keep pictures out of log and live view; masks and boxes stay",
    )
    out.add_argument("--json", action="store_true", help="print one JSON object as the last line of stdout")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the trials, show their scores, and return the exit status."""
    from rich.console import Console

    from adatracker_deploy.core.record import RESULTS
    from adatracker_deploy.trial.salvage import salvage_all

    plans = plans_of(args)
    console = Console(stderr=args.json)
    for line in salvage_all(args.log_dir):
        console.print(line, markup=False, soft_wrap=True)
    summaries: list[dict[str, Any]] = []
    try:
        asked = _drive(plans, args, console, summaries)
    finally:  # one that could not begin raises: those before it are shown all the same
        _show(summaries, args, console, several=len(plans) > 1)
    outcomes = {summary["outcome"] for summary in summaries}
    if asked or "interrupted" in outcomes:
        return 130
    return 0 if outcomes.issubset(RESULTS) else 1


def _drive(
    plans: list[TrialPlan], args: argparse.Namespace, console: Console, summaries: list[dict[str, Any]]
) -> bool:
    """Run the trials, and add the summary of each; return whether a stop was asked for."""
    from adatracker_deploy.runtime.lost_terminal import tolerated
    from adatracker_deploy.runtime.operator_stop import StopRequest
    from adatracker_deploy.runtime.running import Announcement
    from adatracker_deploy.runtime.start_line import StartLine

    with contextlib.closing(Announcement(args.platform, args.name)) as announcement, tolerated():
        stop = StopRequest(announcement.stopping, outlives_terminal=args.on_hangup == "continue")
        with stop.listening():
            if args.together is not None:
                start_line = StartLine(args.together)
                with stop.trial():
                    start_line.wait()
                plans[0] = dataclasses.replace(plans[0], start_line=start_line)
            for summary in _run_all(plans, args, console, announcement, stop):
                summaries.append(summary)  # noqa: PERF402 -- kept even where the next one cannot begin
    return stop.asked


def _show(
    summaries: list[dict[str, Any]], args: argparse.Namespace, console: Console, *, several: bool
) -> None:
    from adatracker_deploy.scoring.summary import summarise_set, timing_words
    from adatracker_deploy.scoring.summary_table import stage_table, summary_table

    if not summaries:
        return
    if args.together is None:  # else the fleet's command shows them all
        if any(summary["rate_hz"] for summary in summaries):
            console.print(stage_table(summaries))
        console.print(summary_table(summaries))
    for row in summaries:
        if not row["timing_kept"]:
            warning = (
                f"warning: {row['trial']}: {timing_words(row)}; left out of means ('score --all' counts it)"
            )
            console.print(warning, markup=False, soft_wrap=True)
    if args.json:
        print(json.dumps(summarise_set(summaries) if several else summaries[0]))


def _run_all(
    plans: list[TrialPlan],
    args: argparse.Namespace,
    console: Console,
    announcement: Announcement,
    stop: StopRequest,
) -> Iterator[dict[str, Any]]:
    """Run the trials; Enter and `--stop-fd` stop one that runs, and nothing while the operator is asked."""
    from adatracker_deploy.app.trial_run import run_trial
    from adatracker_deploy.cli import STARTED_S, asking
    from adatracker_deploy.cli.progress import Progress
    from adatracker_deploy.runtime.operator_stop import heard
    from adatracker_deploy.runtime.teleop.open_hand import KEYBOARD

    asks = _asks(args, plans)
    started_s = STARTED_S
    for number, plan in enumerate(plans, start=1):
        if len(plans) > 1:
            console.rule(f"{plan.platform.name}, trial {number} of {len(plans)}")
        keys = args.teleop == KEYBOARD  # Enter is one of the keys then
        with (
            stop.trial(),
            heard(args.stop_fd, outlives_terminal=stop.outlives_terminal, terminal=not keys) as enter,
        ):
            if enter or keys:
                console.print("Enter or Ctrl-C stops")
            progress = Progress(console, plan.steps, announcement.logging)
            summary = run_trial(plan, progress, started_s, stop)
        ended, last = summary["outcome"], number == len(plans)
        go_on = not (last or stop.asked) and _may_follow(plan, ended)
        if asks:
            summary, go_on = asking.mark(summary, console, partial(_may_follow, plan) if go_on else None)
        yield summary
        started_s = time.monotonic()
        stopped = not (_may_follow(plan, ended) and _may_follow(plan, summary["outcome"]))
        if stop.asked and not last and ended != "interrupted":
            console.print("no further trial: a stop was asked for while this one ended")
        elif stopped and not last and ended != "interrupted":
            console.print("no further trial: after a stop a real robot moves again only when it is told to")
        if stop.asked or not go_on:
            break


def _may_follow(plan: TrialPlan, outcome: str) -> bool:
    """Return whether there may be another trial after one that ended so."""
    from adatracker_deploy.core.record import RESULTS

    moves = not (plan.sitl or plan.dry_run)
    return outcome in RESULTS or (not moves and outcome != "interrupted")


def _asks(args: argparse.Namespace, plans: list[TrialPlan]) -> bool:
    from adatracker_deploy.runtime.operator_stop import in_terminal

    if args.ask is not None:
        return bool(args.ask)
    return len(plans) > 1 and not (args.sitl or args.dry_run) and in_terminal()
