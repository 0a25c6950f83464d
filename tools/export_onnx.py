"""Turn a checkpoint into a policy bundle that a robot runs without torch.

python tools/export_onnx.py CHECKPOINT --out DIR
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import NoReturn

from adatracker_deploy.core.errors import UsageError


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}; see {self.prog} --help")


def main(argv: list[str] | None = None) -> int:
    """Export; return 0 done, 2 a wrong request with one line on stderr."""
    try:
        print(_export(_parser().parse_args(argv)))
    except UsageError as error:
        print(f"export_onnx: {error}", file=sys.stderr)
        return 2
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="export_onnx.py", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("checkpoint", type=Path, help="AdaTracker checkpoint or the Offline-EVT state dict")
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
    parser.add_argument("--force", action="store_true", help="replace the bundle in DIR")
    return parser


def _export(args: argparse.Namespace) -> str:
    try:
        from adatracker_deploy.learning.export import export_checkpoint, largest_difference
    except ImportError as error:
        raise UsageError(f"export needs {error.name}: pip install 'adatracker-deploy[train]'") from error
    from adatracker_deploy.policy.bundle import load_bundle

    manifest = export_checkpoint(
        args.checkpoint,
        args.out,
        interface=args.interface,
        name=args.name,
        rate_hz=args.rate_hz,
        licence=args.licence,
        force=args.force,
    )
    action = ", ".join(f"{'-' if entry.sign < 0 else '+'}{entry.axis}" for entry in manifest.action)
    files = ", ".join(f"{name} {spec.bytes / 1024:.0f} KiB" for name, spec in manifest.files.items())
    return "\n".join(
        (
            f"{manifest.name}: {args.out}",
            f"  files       {files}",
            f"  interface   {manifest.interface}, history {manifest.history}, context {manifest.context}",
            f"  action      {action}, fractions of the robot's limits",
            f"  rate        {manifest.rate_hz:g} Hz",
            f"  licence     {manifest.licence}",
            f"  difference  {largest_difference(load_bundle(args.out)):.1e} at most, torch to onnxruntime",
        )
    )


if __name__ == "__main__":
    sys.exit(main())
