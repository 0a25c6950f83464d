"""Turns a run's arguments into a plan for each trial, checked before anything moves."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.cli.driving import check_teleop, driving_policy
from adatracker_deploy.cli.extras import need
from adatracker_deploy.cli.seeing import providers_of
from adatracker_deploy.config.effects import Effects
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.hub.address import is_hub
from adatracker_deploy.page.address import Address, free_port
from adatracker_deploy.policy.catalogue import is_remote
from adatracker_deploy.trial.live_port import choose_port

if TYPE_CHECKING:
    import argparse

    from adatracker_deploy.app.trial_plan import TrialPlan
    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.faults.schedule import ScheduledFault
    from adatracker_deploy.perception.segmenter import Segmenter
    from adatracker_deploy.platform import Platform, Scenario, Sitl
    from adatracker_deploy.runtime.scheduling import Scheduling

_UNWATCHED_PX = 320
"""Width of a rehearsal's pictures that no eyes look at: they are for the log alone."""


def plans_of(args: argparse.Namespace) -> list[TrialPlan]:
    """Check everything that was asked for; return a plan for each trial, robot by robot.

    Raises:
        UsageError: what was asked for cannot be, in one line.
    """
    if args.platform is None:
        raise UsageError("nothing to do: say which robot with --platform, or see --help")
    names = args.platform.split(",")
    if len(names) > 1 and (not args.sitl or args.profile):
        raise UsageError(
            "several platforms are rehearsed with their own profiles: add --sitl, drop --profile"
        )
    need(_extras(args, names), "this run")
    plans = [_plan(args, name) for name in names]
    if args.live is not None:
        live_port = choose_port(args.live)  # the same for all trials: a viewer finds the next one by itself
        plans = [dataclasses.replace(plan, live_port=live_port) for plan in plans]
    if args.page is not None:
        page = Address(free_port(args.page, "the page", "--page"))  # and so does a browser
        plans = [dataclasses.replace(plan, page=page) for plan in plans]
    return [
        dataclasses.replace(plan, scenario=dataclasses.replace(plan.scenario, seed=args.seed + trial))
        for plan in plans
        for trial in range(args.trials)
    ]


def _extras(args: argparse.Namespace, names: list[str]) -> list[str]:
    """Return the extras that are sure to be needed, so that all that are missing are named at once."""
    from adatracker_deploy.core.camera import is_unreal, scene_of
    from adatracker_deploy.runtime.teleop.open_hand import is_gamepad

    scene = args.scene or scene_of(args.camera or "")
    world = ["sitl"] if args.sitl else ["world"] if scene is not None and not is_unreal(scene) else []
    remote = ["remote"] if is_remote(args.policy) else []
    teleop = ["teleop"] if args.teleop and is_gamepad(args.teleop) else []
    hub = ["hub"] if is_hub(args.policy) else []
    return [*names, *world, *remote, *hub, *teleop, *(["live"] if args.live is not None else ())]


def _plan(args: argparse.Namespace, name: str) -> TrialPlan:
    from adatracker_deploy.app.trial_plan import TrialPlan
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
    check_teleop(args)
    _check_click(args)
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
    for option in ("scene", "others", "person", "effects"):
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
        effects=Effects.read(args.effects or ""),
        width_px=_UNWATCHED_PX if args.segmenter in OF_REHEARSALS else Scenario().width_px,
    )
    if scenario.effects.road != "smooth" and profile.limits.altitude_m is not None:
        raise UsageError("--effects: a body that flies has no road: drop road")
    if virtual:
        _check_world(scenario, args.speed)
    place_for_logs(args.log_dir)
    scheduling = _scheduling(args)
    segmenter, segmenter_name = _segmenter(args, profile, uri, virtual=virtual)
    return TrialPlan(
        name=args.name,
        platform=platform,
        profile=profile,
        policy=driving_policy(args),
        scenario=scenario,
        camera="" if args.sitl and scene is not None else args.camera or "",
        segmenter=segmenter,
        segmenter_name=segmenter_name,
        target=args.target,
        sitl=args.sitl,
        dry_run=args.dry_run,
        steps=args.steps,
        frames=args.frames,
        speed=args.speed or 1.0,
        log_dir=args.log_dir,
        scheduling=scheduling,
        faults=faults,
        teleop=args.teleop or "",
        simulator=_simulator(args, platform, profile),
    )


def _check_click(args: argparse.Namespace) -> None:
    from adatracker_deploy.perception.segmenters import OF_REHEARSALS
    from adatracker_deploy.perception.target.choice import BY_CLICK

    if args.target == BY_CLICK and args.page is None:
        raise UsageError("--target click waits for a click on the page: add --page")
    if args.target == BY_CLICK and args.segmenter in OF_REHEARSALS:
        raise UsageError(f"--segmenter {args.segmenter} knows the target: drop --target click")
    if args.page is not None and args.page == args.live and args.page != 0:
        raise UsageError("--page and --live cannot share a port: give one of them another")


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
        providers=providers_of(args),
    )


def _check_world(scenario: Scenario, speed: float | None) -> None:
    from adatracker_deploy.core.camera import is_unreal

    if not is_unreal(scenario.scene):
        need(["world"], "a virtual world")
    elif speed not in {None, 1.0}:
        raise UsageError("an engine's people walk in the engine's own time: drop --speed")
    elif scenario.person:
        raise UsageError("the people of an engine's levels have their own looks: drop --person")
    elif scenario.effects.fog_m or scenario.effects.sit:
        raise UsageError(
            "an engine's levels have their own weather and people: drop fog and sit from --effects"
        )
    from adatracker_deploy.sim.render import check_person
    from adatracker_deploy.sim.worlds import check_pictures, check_scene

    check_scene(scenario.scene)
    check_pictures(scenario.scene)
    if scenario.person:
        check_person(Path(scenario.person))
