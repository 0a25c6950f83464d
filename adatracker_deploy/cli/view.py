"""``view``: what perception sees, without any robot."""

from __future__ import annotations

import argparse
import contextlib
import json
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adatracker_deploy.cli.seeing import add_segmenter_options
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.policy.catalogue import DEFAULT

if TYPE_CHECKING:
    from rich.console import Console

    from adatracker_deploy.perception.film_writer import FilmWriter
    from adatracker_deploy.perception.mjpeg_server import MjpegServer
    from adatracker_deploy.policy.base import Policy

NO_POLICY = "none"
LIVE_WRITE_HZ = 20.0
"""Frame rate of a video recorded from a live camera, whose frames come irregularly."""


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``view``."""
    parser = commands.add_parser(
        "view",
        help="show what perception sees, without any robot",
        description="Show masks, the target and its state, and what the policy makes of them, over the "
        "picture: in a browser, or as an MP4 (--write). Of a file or folder every frame is looked at.",
    )
    parser.add_argument("camera", metavar="FILE|CAMERA", help="a video file, or anything --camera takes")
    add_segmenter_options(parser, default="embedded")
    parser.add_argument(
        "--policy", metavar="NAME|DIR|URI", default=DEFAULT, help="or 'none' (default: %(default)s)"
    )
    parser.add_argument("--write", metavar="FILE.mp4", type=Path, help="leave what is shown as a film")
    parser.add_argument("--port", metavar="N", type=_port, help="of the page to watch (default: any free)")
    parser.add_argument("--json", action="store_true", help="one JSON object as the last line of stdout")
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
    from adatracker_deploy.core.messages import Frame
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
    policy = _policy(args.policy)
    segmenter, segmenter_name = open_segmenter(
        args.segmenter or EMBEDDED, args.prompt, choice, propagator=args.propagator
    )
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with contextlib.ExitStack() as stack:
        shown = _server(args, stack) if film is None or args.write is None else None
        stack.callback(camera.close)
        camera.open()
        viewer = Viewer(segmenter, policy)
        about = {
            "camera": without_password(args.camera),
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
            console.print(f"watch it at {shown.url} (Ctrl-C ends)")
        frames = film_frames(film, clock, paced=shown is not None) if film else live_frames(camera, clock)
        with console.status("") as status:
            for frame in frames:
                viewed = viewer.look(frame, None if film else clock)
                if writer is not None:
                    writer.write(viewed.picture, frame.t_ns)
                if shown is not None:  # then: whoever saw a picture finds it in the film
                    shown.publish(Frame(viewed.picture, frame.t_ns, frame.seq))
                state = viewed.observation.target
                status.update(f"frame {frame.seq}, {state.value if state else 'no target yet'}")
    return 0


def _check_write(args: argparse.Namespace, *, from_film: bool) -> None:
    from adatracker_deploy.perception.film_writer import check_film_path

    if args.write is None:
        return
    if from_film and args.port is not None:
        raise UsageError("--write goes through a file as fast as it can and shows nothing: drop --port")
    try:
        check_film_path(args.write)
    except UsageError as error:
        raise UsageError(f"--write {error}") from error
    if args.write.exists() and Path(args.camera).exists() and args.write.samefile(args.camera):
        raise UsageError(f"--write {args.write}: this is the film that is looked at; name another file")


def _policy(name: str) -> Policy | None:
    from adatracker_deploy.policy.catalogue import load_policy

    return None if name == NO_POLICY else load_policy(name)


def _server(args: argparse.Namespace, stack: contextlib.ExitStack) -> MjpegServer:
    from adatracker_deploy.perception.mjpeg_server import MjpegServer

    server = MjpegServer(args.port or 0)
    stack.callback(server.close)
    return server


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
        raise argparse.ArgumentTypeError(f"{port} is no port (1 to 65535)")
    return port


_port.__name__ = "whole number"
