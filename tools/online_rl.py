"""Train the paper's baseline "Online RL": reinforcement learning on one body after another.

python tools/online_rl.py --out DIR
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
    """Train; return 0 done, 2 a wrong request with one line on stderr, 130 interrupted."""
    try:
        print(_train(_parser().parse_args(argv)))
    except UsageError as error:
        print(f"online_rl: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("online_rl: interrupted; the same command goes on with the body it was at", file=sys.stderr)
        return 130
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="online_rl.py", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="the run's folder")
    parser.add_argument(
        "--condition", metavar="NAME", help="of the episodes: clean, field, hard or wide (clean)"
    )
    parser.add_argument("--steps", type=int, metavar="N", help="with each of the 16 bodies (default: 50000)")
    parser.add_argument("--seed", type=int, metavar="S", help="(default: 0)")
    return parser


def _train(args: argparse.Namespace) -> Path:
    try:
        from adatracker_deploy.learning.train.online_rl import OnlineSettings, train_online
    except ImportError as error:
        raise UsageError(f"this needs {error.name}: pip install 'adatracker-deploy[train,rl]'") from error
    from adatracker_deploy.config.schema import parse
    from adatracker_deploy.learning.conditions import condition_named

    keys = ("condition", "steps", "seed")
    given = {key: getattr(args, key) for key in keys if getattr(args, key) is not None}
    settings = parse(OnlineSettings, given, where="online_rl")
    condition_named(settings.condition)
    return train_online(settings, args.out, say=lambda text: print(text, file=sys.stderr))


if __name__ == "__main__":
    raise SystemExit(main())
