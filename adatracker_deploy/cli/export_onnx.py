"""``export-onnx``: a checkpoint as a policy bundle."""

from __future__ import annotations

import argparse
from pathlib import Path

from adatracker_deploy.core.errors import UsageError


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``export-onnx``."""
    parser = commands.add_parser(
        "export-onnx",
        help="turn a checkpoint into a policy bundle",
        description="Turn a checkpoint into a policy bundle, which a robot runs without torch.",
    )
    parser.add_argument(
        "checkpoint",
        type=Path,
        nargs="+",
        help="AdaTracker checkpoint or the Offline-EVT state dict; of several AdaTrackers, the mean of their "
        "weights: for runs that began with the same",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="the bundle's folder")
    parser.add_argument(
        "--interface",
        choices=("streaming", "window"),
        help="give the encoder one mask-action pair a tick (default), or the whole history",
    )
    parser.add_argument("--name", help="the policy's name (default: the checkpoint's)")
    parser.add_argument(
        "--rate-hz", type=float, metavar="HZ", help="rate to run at (default: the checkpoint's)"
    )
    parser.add_argument(
        "--licence", metavar="TEXT", help="licence of the weights (default: the checkpoint's)"
    )
    parser.add_argument(
        "--search",
        action="store_true",
        help="have it turn to the side of the last sight once the target may have left its view; for those "
        "that were trained with --belief",
    )
    parser.add_argument(
        "--late",
        type=Path,
        nargs="+",
        default=[],
        metavar="CHECKPOINT",
        help="what drives bodies that obey late, by delay and lag of more than 1.35 s together; of a run "
        "that began with the other's, told the response",
    )
    parser.add_argument("--force", action="store_true", help="replace the bundle in DIR")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Export it, and tell what came of it.

    Raises:
        UsageError: torch is not installed, the checkpoint cannot be read, or the folder is taken.
    """
    try:
        from adatracker_deploy.learning.export import export_checkpoint, largest_difference
    except ImportError as error:
        raise UsageError(f"export needs {error.name}: pip install 'adatracker-deploy[train]'") from error
    from adatracker_deploy.policy.bundle import load_bundle

    manifest = export_checkpoint(
        args.checkpoint[0],
        args.out,
        others=args.checkpoint[1:],
        late=args.late,
        interface=args.interface,
        name=args.name,
        rate_hz=args.rate_hz,
        licence=args.licence,
        search=args.search,
        force=args.force,
    )
    action = ", ".join(f"{'-' if entry.sign < 0 else '+'}{entry.axis}" for entry in manifest.action)
    files = ", ".join(f"{name} {spec.bytes / 1024:.0f} KiB" for name, spec in manifest.files.items())
    lines = (
        f"{manifest.name}: {args.out}",
        f"  files       {files}",
        f"  interface   {manifest.interface}, history {manifest.history}, context {manifest.context}",
        f"  action      {action}, fractions of the robot's limits",
        f"  rate        {manifest.rate_hz:g} Hz",
        f"  licence     {manifest.licence}",
        f"  difference  {largest_difference(load_bundle(args.out)):.1e} at most, torch to onnxruntime",
    )
    print("\n".join(lines))
    return 0
