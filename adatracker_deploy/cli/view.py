"""``view``: what perception sees, without any robot."""

from __future__ import annotations

import argparse
import contextlib
import json
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adatracker_deploy.cli.seeing import add_provider_option, add_segmenter_options, providers_of
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.policy.catalogue import DEFAULT

if TYPE_CHECKING:
    from rich.console import Console

    from adatracker_deploy.app.view_page import ViewPage
    from adatracker_deploy.perception.film_writer import FilmWriter
    from adatracker_deploy.perception.segmenter import Segmenter
    from adatracker_deploy.policy.base import Policy

NO_POLICY = "none"
LIVE_WRITE_HZ = 20.0
"""Frame rate of a video recorded from a live camera, whose frames come irregularly."""


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``view``."""
    parser = commands.add_parser(
        "view",
        help="show what perception sees, without any robot",
        description="Show masks, the target and its state, and the policy's command, over the "
        "picture: on a page in a browser, where a click chooses the target, or as an MP4 (--write). Every "
        "frame of a file or folder is used.",
    )
    parser.add_argument("camera", metavar="FILE|CAMERA", help="a video file, or anything --camera takes")
    add_segmenter_options(parser, default="embedded")
    add_provider_option(parser)
    parser.add_argument(
        "--policy",
        metavar="NAME|DIR|URI",
        default=DEFAULT,
        help="the policy, or 'none' (default: %(default)s)",
    )
    parser.add_argument("--write", metavar="FILE.mp4", type=Path, help="write the view as a film")
    parser.add_argument(
        "--port", metavar="N", type=_port, help="port of the page to watch (default: any free one)"
    )
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object as the last line of stdout"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Look until the film is over, the camera is gone or somebody interrupts; return the exit status.

    Raises:
        UsageError: the request is wrong.
        PlatformError: the camera is gone, or a film cannot be written.
    """
    from rich.console import Console

    from adatracker_deploy.app.view_run import Viewer, film_frames, live_frames
    from adatracker_deploy.core.camera import without_password
    from adatracker_deploy.core.clock import MonotonicClock
    from adatracker_deploy.perception.film import FilmCamera
    from adatracker_deploy.perception.segmenters import EMBEDDED, open_segmenter
    from adatracker_deploy.perception.sources import open_source
    from adatracker_deploy.perception.target.choice import Choice

    console = Console(stderr=args.json, highlight=False, soft_wrap=True)
    clock = MonotonicClock()
    choice = Choice.read(args.target)
    camera = open_source(args.camera, clock, every_frame=True)
    film = camera if isinstance(camera, FilmCamera) else None
    _check_write(args, from_film=film is not None)
    policy = _policy(args.policy, args.provider or "cpu")
    segmenter, segmenter_name = open_segmenter(
        args.segmenter or EMBEDDED,
        args.prompt,
        choice,
        propagator=args.propagator,
        providers=providers_of(args),
    )
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with contextlib.ExitStack() as stack:
        name = without_password(args.camera)
        shown = _page(args, name, segmenter, stack) if film is None or args.write is None else None
        stack.callback(camera.close)
        camera.open()
        viewer = Viewer(segmenter, policy)
        about = {
            "camera": name,
            "segmenter": segmenter_name,
            "policy": policy.info.name if policy else None,
            "written": str(args.write) if args.write else None,
        }

        def tell(error: type[BaseException] | None, *_: object) -> None:
            if error is None or not issubclass(error, UsageError):
                _show(console, args, about | viewer.summary())

        stack.push(tell)
        writer = _writer(args, film.rate_hz if film else LIVE_WRITE_HZ, stack)
        console.print(f"segmenter: {segmenter_name}", markup=False)
        if shown is not None:
            console.print(f"watch it at {shown.url} (Ctrl-C ends)", markup=False)
        frames = film_frames(film, clock, paced=shown is not None) if film else live_frames(camera, clock)
        with console.status("") as status:
            for frame in frames:
                viewed = viewer.look(shown.with_click(frame) if shown else frame)
                if writer is not None:
                    writer.write(viewer.drawn(viewed, None if film else clock), frame.t_ns)
                if shown is not None:  # then: every picture shown is in the film
                    shown.show(viewed, viewer.moves(viewed), None if film else clock)
                state = viewed.observation.target
                status.update(f"frame {frame.seq}, {state.value if state else 'no target yet'}")
    return 0


def _check_write(args: argparse.Namespace, *, from_film: bool) -> None:
    from adatracker_deploy.perception.film_writer import check_film_path
    from adatracker_deploy.perception.target.choice import BY_CLICK

    if args.write is None:
        return
    if from_film and args.target == BY_CLICK:
        raise UsageError("--write goes through a file and shows nothing to click on: drop --target click")
    if from_film and args.port is not None:
        raise UsageError("--write goes through a file as fast as it can and shows nothing: drop --port")
    try:
        check_film_path(args.write)
    except UsageError as error:
        raise UsageError(f"--write {error}") from error
    if args.write.exists() and Path(args.camera).exists() and args.write.samefile(args.camera):
        raise UsageError(f"--write {args.write}: this is the input film; name another file")


def _policy(name: str, provider: str) -> Policy | None:
    from adatracker_deploy.policy.catalogue import load_policy

    return None if name == NO_POLICY else load_policy(name, provider)


def _page(
    args: argparse.Namespace, camera: str, segmenter: Segmenter, stack: contextlib.ExitStack
) -> ViewPage:
    from adatracker_deploy.app.view_page import ViewPage
    from adatracker_deploy.page.address import Address, free_port

    address = Address(free_port(args.port or 0, "the page", "--port"))
    page = ViewPage(address, camera, args.policy, args.target, segmenter)
    stack.callback(page.close)
    return page


def _writer(args: argparse.Namespace, rate_hz: float, stack: contextlib.ExitStack) -> FilmWriter | None:
    from adatracker_deploy.perception.film_writer import FilmWriter

    if args.write is None:
        return None
    writer = FilmWriter(args.write, rate_hz)
    stack.callback(writer.close)
    return writer


def _show(console: Console, args: argparse.Namespace, summary: dict[str, Any]) -> None:
    if args.json:
        print(json.dumps(summary))
        return
    if not summary["frames"]:
        return
    states = ", ".join(f"{count} {name}" for name, count in summary["states"].items() if count)
    ms = summary["frame_ms"]
    lines = [
        f"frames     {summary['frames']}, {summary['rate_hz']:.1f} Hz",
        f"target     seen in {summary['tracked']:.1%}: {states}",
        f"per frame  p50 {ms['p50']:.1f} ms, p95 {ms['p95']:.1f} ms",
        *([f"written    {summary['written']}"] if summary["written"] else []),
    ]
    console.print("\n".join(lines), markup=False)


def _port(text: str) -> int:
    port = int(text)
    if not 1 <= port <= 65535:
        raise argparse.ArgumentTypeError(f"{port} is not a port (1 to 65535)")
    return port


_port.__name__ = "whole number"
