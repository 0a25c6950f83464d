"""The run itself: ``adatracker-deploy --platform NAME [--sitl] ...``."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import os
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adatracker_deploy.cli.driving import add_policy_options, driving_policy
from adatracker_deploy.cli.extras import need
from adatracker_deploy.cli.ranges import real, whole
from adatracker_deploy.cli.seeing import add_segmenter_options
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.policy.catalogue import is_remote
from adatracker_deploy.trial.live_port import DEFAULT_PORT, choose_port

if TYPE_CHECKING:
    from rich.console import Console

    from adatracker_deploy.app.trial_run import TrialPlan
    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.faults.schedule import ScheduledFault
    from adatracker_deploy.perception.segmenter import Segmenter
    from adatracker_deploy.platform import Platform, Scenario, Sitl
    from adatracker_deploy.runtime.operator_stop import StopRequest
    from adatracker_deploy.runtime.running import Announcement
    from adatracker_deploy.runtime.scheduling import Scheduling

_UNWATCHED_PX = 320
"""Width of a rehearsal's pictures that no eyes look at: they are for the log alone."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the run's options to the command itself."""
    what = parser.add_argument_group("what to run")
    what.add_argument(
        "--platform",
        metavar="NAME",
        help="the robot: see 'adatracker-deploy platforms'; with --sitl also several, NAME,NAME,...",
    )
    what.add_argument("--sitl", action="store_true", help="simulate the simulator of the robot's wire")
    what.add_argument(
        "--dry-run", action="store_true", help="run everything but the actuators: no robot is connected"
    )
    what.add_argument("--profile", metavar="NAME|FILE", help="the robot's profile (default: the platform's)")
    add_policy_options(what)
    how = parser.add_argument_group("how")
    how.add_argument("--steps", type=whole(1, 1_000_000), default=600, help="ticks (default: %(default)s)")
    how.add_argument("--trials", type=whole(1, 1000), default=1, help="trials, seeds from --seed up")
    how.add_argument("--seed", type=whole(0, 2**31 - 1), default=0, help="of the world and the simulation")
    how.add_argument(
        "--speed-cap",
        type=real(0.01, 1),
        default=1.0,
        metavar="SHARE",
        help="of the profile's speeds, turning too: 0.25 for the first steps of a real robot (default: 1)",
    )
    how.add_argument(
        "--ask",
        action=argparse.BooleanOptionalAction,
        help="after each trial ask how it ended, and before the next whether to begin (default: with several "
        "trials on a real robot, in a terminal)",
    )
    how.add_argument(
        "--stop-fd",
        type=whole(0, 65535),
        metavar="N",
        help="stop when this file descriptor can be read or is closed: for buttons and other hooks",
    )
    how.add_argument(
        "--speed",
        type=real(1, 20),
        help="times real time, 1 to 20; only with --sitl; above 2 eyes fall behind: add --segmenter truth",
    )
    how.add_argument(
        "--realtime",
        action="store_true",
        help="real-time priority (SCHED_FIFO) for the loop and the link, which the system must allow",
    )
    how.add_argument("--cpu", metavar="LIST", help="cores for the loop and the link: 2, or 0,2-3")
    how.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="NAME@WHEN,...",
        help="with --sitl: make this go wrong so many seconds after the first followed tick, or in a phase "
        "of the trial: PHASE, PHASE+SECONDS (docs/safety.md)",
    )
    how.add_argument("--simulator", type=Path, help=argparse.SUPPRESS)  # the fault matrix's, still running
    view = parser.add_argument_group("what it sees")
    view.add_argument(
        "--camera",
        metavar="URI",
        help="world://SCENE: a virtual world, also for a real robot; robot://TOPIC: on its own wire; "
        "or a device's number, a file, a folder of pictures, an http, rtsp or gst address",
    )
    view.add_argument("--scene", metavar="NAME", help="of the virtual world (default: simple_room)")
    view.add_argument(
        "--target-speed", type=real(0, 5), default=1.0, metavar="M_S", help="of the person (default: 1.0)"
    )
    view.add_argument(
        "--others", type=whole(0, 20), default=0, metavar="N", help="people in it besides the target"
    )
    view.add_argument(
        "--person",
        type=Path,
        metavar="GLB",
        help="of the virtual world: who is followed, a walking glTF figure",
    )
    add_segmenter_options(
        view,
        default="embedded; a virtual world has truth, too, and noisy: truth with the embedded one's mistakes",
    )
    out = parser.add_argument_group("what it leaves")
    out.add_argument("--log-dir", type=Path, default=Path("trials"), help="default: %(default)s")
    out.add_argument(
        "--live",
        type=whole(0, 65535),
        nargs="?",
        const=DEFAULT_PORT,
        metavar="PORT",
        help="show the trial in Foxglove while it runs: a websocket of this machine alone, on PORT "
        "(default: %(const)s; 0: any free one)",
    )
    kept = out.add_mutually_exclusive_group()
    kept.add_argument(
        "--blur",
        action="store_const",
        dest="frames",
        const="blurred",
        default="full",
        help="in the pictures of log and live view, blur everyone but the target whom perception sees",
    )
    kept.add_argument(
        "--no-frames",
        action="store_const",
        dest="frames",
        const="none",
        help="leave pictures out of log and live view; masks and boxes stay",
    )
    out.add_argument("--json", action="store_true", help="one JSON object as the last line of stdout")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the trials, show their scores, and return the exit status."""
    from rich.console import Console

    from adatracker_deploy.core.record import RESULTS
    from adatracker_deploy.runtime.operator_stop import StopRequest
    from adatracker_deploy.runtime.running import Announcement
    from adatracker_deploy.scoring.summary import summarise_set, timing_words
    from adatracker_deploy.scoring.summary_table import stage_table, summary_table
    from adatracker_deploy.trial.salvage import salvage_all

    plans = _plans(args)
    console = Console(stderr=args.json)
    for line in salvage_all(args.log_dir):
        console.print(line, markup=False, soft_wrap=True)
    with contextlib.closing(Announcement(args.platform)) as announcement:
        stop = StopRequest(announcement.stopping)
        with stop.listening():
            summaries = _run_all(plans, args, console, announcement, stop)
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
        print(json.dumps(summaries[0] if len(plans) == 1 else summarise_set(summaries)))
    outcomes = {summary["outcome"] for summary in summaries}
    if stop.asked or "interrupted" in outcomes:
        return 130
    return 0 if outcomes.issubset(RESULTS) else 1


def _run_all(
    plans: list[TrialPlan],
    args: argparse.Namespace,
    console: Console,
    announcement: Announcement,
    stop: StopRequest,
) -> list[dict[str, Any]]:
    """Run the trials; Enter and `--stop-fd` stop one that runs, and nothing while the operator is asked."""
    from adatracker_deploy.app.trial_run import run_trial
    from adatracker_deploy.cli import STARTED_S, asking
    from adatracker_deploy.cli.progress import Progress
    from adatracker_deploy.runtime.operator_stop import heard

    asks = _asks(args, plans)
    summaries: list[dict[str, Any]] = []
    started_s = STARTED_S
    for number, plan in enumerate(plans, start=1):
        if len(plans) > 1:
            console.rule(f"{plan.platform.name}, trial {number} of {len(plans)}")
        with stop.trial(), heard(args.stop_fd) as enter:
            if enter:
                console.print("Enter or Ctrl-C stops")
            progress = Progress(console, plan.steps, announcement.logging)
            summary = run_trial(plan, progress, started_s, stop)
        ended, last = summary["outcome"], number == len(plans)
        go_on = not (last or stop.asked) and _may_follow(plan, ended)
        if asks:
            summary, go_on = asking.mark(summary, console, partial(_may_follow, plan) if go_on else None)
        summaries.append(summary)
        started_s = time.monotonic()
        stopped = not (_may_follow(plan, ended) and _may_follow(plan, summary["outcome"]))
        if stop.asked and not last and ended != "interrupted":
            console.print("no further trial: a stop was asked for while this one ended")
        elif stopped and not last and ended != "interrupted":
            console.print("no further trial: after a stop a real robot moves again only when it is told to")
        if stop.asked or not go_on:
            break
    return summaries


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


def _plans(args: argparse.Namespace) -> list[TrialPlan]:
    """Check everything that was asked for before anything moves; a plan for each trial, robot by robot."""
    if args.platform is None:
        raise UsageError("nothing to do: say which robot with --platform, or see --help")
    names = args.platform.split(",")
    if len(names) > 1 and (not args.sitl or args.profile):
        raise UsageError(
            "several platforms are rehearsed with their own profiles: add --sitl, drop --profile"
        )
    need(_extras(args, names), f"--platform {args.platform}{' --sitl' if args.sitl else ''}")
    plans = [_plan(args, name) for name in names]
    if args.live is not None:
        live_port = choose_port(args.live)  # the same for all trials: a viewer finds the next one by itself
        plans = [dataclasses.replace(plan, live_port=live_port) for plan in plans]
    return [
        dataclasses.replace(plan, scenario=dataclasses.replace(plan.scenario, seed=args.seed + trial))
        for plan in plans
        for trial in range(args.trials)
    ]


def _extras(args: argparse.Namespace, names: list[str]) -> list[str]:
    """Return the extras that are sure to be needed, so that all that are missing are named at once."""
    virtual = args.scene or (args.camera or "").startswith("world:")
    world = ["sitl"] if args.sitl else ["world"] if virtual else []
    remote = ["remote"] if is_remote(args.policy) else []
    return [*names, *world, *remote, *(["live"] if args.live is not None else ())]


def _plan(args: argparse.Namespace, name: str) -> TrialPlan:
    from adatracker_deploy.app.trial_run import TrialPlan
    from adatracker_deploy.core.camera import WORLD, scene_of
    from adatracker_deploy.perception.segmenters import OF_REHEARSALS
    from adatracker_deploy.perception.sources import check_uri
    from adatracker_deploy.platform import Scenario
    from adatracker_deploy.registry import load_platform, load_profile
    from adatracker_deploy.trial.folder import place_for_logs

    if args.dry_run and args.sitl:
        raise UsageError("--dry-run moves nothing, --sitl moves a simulated robot: give one of them")
    if args.speed is not None and not args.sitl:
        raise UsageError("--speed is for rehearsals: a real robot cannot be sped up; add --sitl")
    platform = load_platform(name)
    profile = load_profile(args.profile or platform.default_profile, platform)
    faults = _faults(args, platform, profile) if args.fault else ()
    if args.speed_cap < 1:
        profile = dataclasses.replace(profile, limits=profile.limits.capped(args.speed_cap))
    uri = args.camera or profile.camera.uri
    if args.camera or not args.sitl:  # a simulator brings its own
        check_uri(uri)
    scene = scene_of(uri)
    if args.scene and args.camera and scene is not None:
        raise UsageError(f"--scene NAME is short for --camera {WORLD}NAME: give one of them")
    virtual = args.sitl or scene is not None
    for option in ("scene", "others", "person"):
        if getattr(args, option) and not virtual:
            raise UsageError(
                f"--{option} needs a virtual world: add --sitl, or --camera {WORLD}{args.scene or 'SCENE'}"
            )
    scenario = Scenario(
        scene=args.scene or scene or Scenario().scene,
        target_speed_m_s=args.target_speed,
        seed=args.seed,
        others=args.others,
        person="" if args.person is None else str(args.person.resolve()),
        width_px=_UNWATCHED_PX if args.segmenter in OF_REHEARSALS else Scenario().width_px,
    )
    if virtual:
        _check_world(scenario)
    place_for_logs(args.log_dir)
    scheduling = _scheduling(args)
    segmenter, segmenter_name = _segmenter(args, profile, uri, virtual=virtual)
    return TrialPlan(
        platform=platform,
        profile=profile,
        policy=driving_policy(args),
        scenario=scenario,
        camera="" if args.sitl and scene is not None else args.camera or "",
        segmenter=segmenter,
        segmenter_name=segmenter_name,
        sitl=args.sitl,
        dry_run=args.dry_run,
        steps=args.steps,
        frames=args.frames,
        speed=args.speed or 1.0,
        log_dir=args.log_dir,
        scheduling=scheduling,
        faults=faults,
        simulator=_simulator(args, platform, profile),
    )


def _scheduling(args: argparse.Namespace) -> Scheduling:
    from adatracker_deploy.runtime.scheduling import Scheduling, read_cpus

    cpus = frozenset[int]() if args.cpu is None else read_cpus(args.cpu, os.sched_getaffinity(0))
    scheduling = Scheduling(args.realtime, cpus)
    scheduling.check()
    return scheduling


def _faults(
    args: argparse.Namespace, platform: type[Platform], profile: Profile
) -> tuple[ScheduledFault, ...]:
    from adatracker_deploy.core.faults import known_faults
    from adatracker_deploy.faults.schedule import parse_schedule

    if not args.sitl:
        raise UsageError("--fault is for rehearsals: nothing is made to fail on a real robot; add --sitl")
    if args.speed is not None and args.speed != 1:
        raise UsageError("--fault counts in the machine's seconds: drop --speed")
    if args.camera:
        raise UsageError("--fault is for the simulated robot with its own camera: drop --camera")
    known = known_faults(platform.sitl(profile).faults)
    return parse_schedule(args.fault, known, flies="vz" in platform.axes)


def _simulator(args: argparse.Namespace, platform: type[Platform], profile: Profile) -> Sitl | None:
    if args.simulator is None or not args.sitl:
        return None
    from adatracker_deploy.faults.running_simulator import RunningSimulator

    return RunningSimulator(args.simulator, platform, profile)


def _segmenter(
    args: argparse.Namespace, profile: Profile, uri: str, *, virtual: bool
) -> tuple[Segmenter, str]:
    from adatracker_deploy.core.camera import ON_A_WIRE
    from adatracker_deploy.perception.segmenters import EMBEDDED, OF_REHEARSALS, open_segmenter
    from adatracker_deploy.perception.target.choice import Choice

    name = args.segmenter or EMBEDDED
    # A simulated robot that was started by hand sends the truth as well: the first frame will tell.
    if name in OF_REHEARSALS and not virtual and not uri.startswith(ON_A_WIRE):
        raise UsageError(f"--segmenter {name} needs a virtual world: add --sitl, or --camera world://SCENE")
    return open_segmenter(
        name,
        args.prompt,
        Choice.read(args.target),
        propagator=args.propagator,
        rate_hz=profile.camera.rate_hz,
    )


def _check_world(scenario: Scenario) -> None:
    try:
        from adatracker_deploy.sim import check_scene
    except ImportError as error:
        raise UsageError(
            f"a virtual world needs {error.name}: pip install 'adatracker-deploy[world]'"
        ) from error
    from adatracker_deploy.sim.render import check_person, check_renderer

    check_scene(scenario.scene)
    check_renderer()
    if scenario.person:
        check_person(Path(scenario.person))
