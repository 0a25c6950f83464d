"""``doctor``: is this machine, and this robot, fit for a trial? Nothing is engaged and nothing moves."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.cli.extras import need
from adatracker_deploy.cli.ranges import real
from adatracker_deploy.cli.seeing import add_provider_option, add_segmenter_options, providers_of
from adatracker_deploy.core.errors import PlatformError, UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.camera import Camera
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.platform import Check, Platform
    from adatracker_deploy.policy.base import Policy

Found = tuple[str, "Check"]
"""The part that was checked, and the result."""


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "doctor",
        help="check whether this machine and robot are fit for a trial, and how to fix what is not",
        description="Check the machine and, with --platform, the robot over its wire. Nothing is engaged.",
    )
    parser.add_argument("--platform", metavar="NAME", help="connect to this robot and check it")
    parser.add_argument(
        "--profile", metavar="NAME|FILE", help="the robot's profile (default: the platform's)"
    )
    parser.add_argument("--sitl", action="store_true", help="check a simulated robot")
    parser.add_argument(
        "--policy", metavar="NAME|DIR|URI", default="adatracker", help="(default: %(default)s)"
    )
    parser.add_argument("--camera", metavar="URI", help="(default: the profile's, with --platform)")
    add_segmenter_options(parser, default="embedded")
    add_provider_option(parser)
    parser.add_argument("--log-dir", type=Path, default=Path("trials"), help="default: %(default)s")
    parser.add_argument(
        "--seconds",
        type=real(1, 3600),
        default=10.0,
        help="time for which the loop is timed, 1 to 3600 s (default: 10)",
    )
    parser.add_argument(
        "--fix", action="store_true", help="print the commands that fix the findings; runs none of them"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object on stdout")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Look at everything, show it, and return 1 if something must be fixed first."""
    from rich.console import Console

    examination = _Examination(args)
    console = Console(stderr=args.json)
    found: list[Found] = []
    for part, check in examination.all():
        if not found or found[-1][0] != part:
            console.print(f"[bold]{part}[/bold]")
        found.append((part, check))
        sign = (
            "[green]ok  [/green]"
            if check.ok
            else "[red]NO  [/red]"
            if check.blocking
            else "[yellow]hm  [/yellow]"
        )
        console.print(f"  {sign} {check.name:<20} ", end="")
        console.print(check.message, markup=False, highlight=False, soft_wrap=True)
    refused = [check for _, check in found if not check.ok and check.blocking]
    doubted = [check for _, check in found if not check.ok and not check.blocking]
    console.print(_verdict(len(refused), len(doubted)))
    if args.fix:
        console.print(_commands(found), markup=False, highlight=False, soft_wrap=True)
    if args.json:
        checks = [{"part": part, **dataclasses.asdict(check)} for part, check in found]
        print(json.dumps({"fit": not refused, "checks": checks}))
    return 1 if refused else 0


def _verdict(refused: int, doubted: int) -> str:
    if refused:
        return f"not fit for a trial: {refused} to fix"
    return "fit for a trial" + (f"; {doubted} could be better" if doubted else "")


def _commands(found: list[Found]) -> str:
    """Return a shell script of the fixes that are known, each once and below its check's name."""
    fixes = {check.fix: check.name for _, check in found if check.fix}
    if not fixes:
        return "# no command fixes more"
    return "\n".join(f"# {name}\n{fix}" for fix, name in fixes.items())


class _Examination:
    """Everything that was asked for, checked before anything is connected."""

    def __init__(self, args: argparse.Namespace) -> None:
        from adatracker_deploy.core.clock import MonotonicClock
        from adatracker_deploy.perception.segmenters import EMBEDDED, OF_REHEARSALS, open_segmenter
        from adatracker_deploy.perception.sources import check_uri
        from adatracker_deploy.perception.target.choice import Choice
        from adatracker_deploy.policy.catalogue import load_policy
        from adatracker_deploy.registry import load_platform, load_profile
        from adatracker_deploy.trial.folder import place_for_logs

        if args.platform is None and (args.sitl or args.profile):
            raise UsageError("--sitl and --profile need a robot: name it with --platform")
        robot = [args.platform] if args.platform else []
        need([*robot, *(["sitl"] if args.sitl else ())], "doctor")
        if args.camera:
            check_uri(args.camera)
        self._args = args
        self._place = place_for_logs(args.log_dir)
        self._clock: Clock = MonotonicClock()
        self._policy: Policy = load_policy(args.policy, args.provider or "cpu")
        self._platform: type[Platform] | None = load_platform(args.platform) if args.platform else None
        self._profile: Profile | None = None
        if self._platform is not None:
            self._profile = load_profile(args.profile or self._platform.default_profile, self._platform)
        name = args.segmenter or EMBEDDED
        self._segmenter, self._segmenter_name = None, ""
        if name not in OF_REHEARSALS:
            self._segmenter, self._segmenter_name = open_segmenter(
                name,
                args.prompt,
                Choice.read(args.target),
                propagator=args.propagator,
                providers=providers_of(args),
            )

    def all(self) -> Iterator[Found]:
        """Look at one thing after the other."""
        from adatracker_deploy.doctor.machine import machine_checks

        for check in machine_checks(self._place):
            yield "machine", check
        for check in self._timing():
            yield "timing", check
        with contextlib.ExitStack() as stack:
            profile = self._profile
            if self._platform is not None and profile is not None:
                for check in self._robot(stack, self._platform, profile):
                    yield self._platform.name, check
            elif self._args.camera:
                yield "camera", self._camera(self._open(None))

    def _timing(self) -> Iterator[Check]:
        from adatracker_deploy.doctor import timing

        info = self._policy.info
        yield timing.disk_check(timing.measured_disk(self._place))
        yield timing.policy_check(
            timing.measured_policy(self._policy, self._clock), info.rate_hz, info.runs_on
        )
        if self._segmenter is not None:
            yield timing.perception_check(
                timing.measured_perception(self._segmenter, self._clock), self._segmenter_name
            )
        late = timing.measured_lateness(self._policy, self._clock, self._args.seconds)
        yield timing.lateness_check(late, info.rate_hz)

    def _robot(
        self, stack: contextlib.ExitStack, platform: type[Platform], profile: Profile
    ) -> Iterator[Check]:
        from adatracker_deploy.core.camera import scene_of
        from adatracker_deploy.platform import Check, Scenario
        from adatracker_deploy.runtime.link_process import LinkProcess

        if self._args.sitl:
            profile = stack.enter_context(platform.sitl(profile)).start(self._clock, Scenario())
        if self._args.camera:
            profile = dataclasses.replace(
                profile, camera=dataclasses.replace(profile.camera, uri=self._args.camera)
            )
        try:
            yield from stack.enter_context(LinkProcess(platform, profile, self._clock)).connect()
        except PlatformError as error:
            yield Check("connection", ok=False, message=str(error))
            return
        if scene_of(profile.camera.uri) is None:
            yield self._camera(self._open(profile))

    def _open(self, profile: Profile | None) -> Camera:
        from adatracker_deploy.core.camera import ROBOT
        from adatracker_deploy.perception.sources import open_source

        uri = profile.camera.uri if profile else self._args.camera
        if profile is not None and self._platform is not None and uri.startswith(ROBOT):
            return self._platform.camera(profile, self._clock)
        return open_source(uri, self._clock)

    def _camera(self, camera: Camera) -> Check:
        from adatracker_deploy.doctor import timing
        from adatracker_deploy.perception.live import NO_STAMPS, LiveCamera
        from adatracker_deploy.platform import Check

        with contextlib.closing(camera):
            try:
                camera.open()
                camera.go()
                rate_hz, shape = timing.measured_camera(camera, self._clock)
                hides_delay = isinstance(camera, LiveCamera) and camera.hides_delay
            except (PlatformError, UsageError) as error:
                return Check("camera", ok=False, message=str(error))
        check = timing.camera_check(rate_hz, shape, self._policy.info.rate_hz)
        return dataclasses.replace(check, message=f"{check.message}; {NO_STAMPS}") if hides_delay else check
