"""``train``: a policy, from collected data."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from adatracker_deploy.learning.train.settings import TrainSettings

_VARIANTS = ("identification", "dynamics", "consistency", "encoder", "lstm", "last-action", "search")
_LINE_EVERY_S = 30.0


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``train``."""
    parser = commands.add_parser(
        "train",
        help="train a policy",
        description="Train a policy on collected data; the run can be interrupted and resumed.",
    )
    parser.add_argument(
        "--data",
        metavar="DIR",
        type=Path,
        action="append",
        required=True,
        help="of shards, or of such folders",
    )
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="the run's folder")
    parser.add_argument("--recipe", metavar="NAME|FILE", default="deploy", help="(default: %(default)s)")
    parser.add_argument(
        "--method", choices=("dagger", "awr", "cql_sac"), default="dagger", help="(default: %(default)s)"
    )
    parser.add_argument(
        "--variant",
        metavar="NAME",
        action="append",
        default=[],
        help=f"leave something out, more than one if repeated: {', '.join(f'no-{v}' for v in _VARIANTS)}",
    )
    parser.add_argument("--init", metavar="RUN", help="begin with the weights of another run's folder")
    parser.add_argument("--rate", metavar="R", type=float, help="learning rate (default: the method's)")
    parser.add_argument("--updates", metavar="N", type=int, help="in all")
    parser.add_argument("--rounds", metavar="N", type=int, help="of DAgger")
    parser.add_argument("--round-steps", metavar="N", type=int, help="visited for each round")
    parser.add_argument("--batch", metavar="N", type=int, help="sequences in a batch")
    parser.add_argument("--length", metavar="N", type=int, help="steps of a sequence")
    parser.add_argument("--seed", metavar="S", type=int, help="(default: 0)")
    parser.add_argument("--device", default="cpu", help="cpu, cuda, cuda:1 (default: %(default)s)")
    cores = len(os.sched_getaffinity(0))
    parser.add_argument("--threads", metavar="N", type=int, default=cores, help="of torch, on the CPU")
    parser.add_argument("--workers", metavar="N", type=int, default=cores, help="processes that visit")
    parser.add_argument(
        "--bfloat16", action="store_true", help="compute with fewer digits where it is faster"
    )
    parser.add_argument("--resume", action="store_true", help="go on with the run in --out")
    parser.add_argument("--json", action="store_true", help="one JSON object as the only line of stdout")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Train; return the exit status.

    Raises:
        UsageError: a number out of range, an unknown name, a missing extra, or a folder of another run.
    """
    try:
        import torch

        from adatracker_deploy.learning.train.run import train
    except ImportError as error:
        raise UsageError(f"training needs {error.name}: pip install 'adatracker-deploy[train]'") from error
    for name in ("threads", "workers"):
        if (value := getattr(args, name)) < 1:
            raise UsageError(f"--{name}: {value} is out of range, at least 1")
    torch.set_num_threads(args.threads)
    settings = _settings(args)
    begin_s = time.monotonic()
    checkpoint = train(
        settings,
        args.data,
        args.out,
        resume=args.resume,
        device=args.device,
        workers=args.workers,
        say=lambda text: print(text, file=sys.stderr),
        tell=_Progress(settings.updates),
    )
    if args.json:
        taken_s = round(time.monotonic() - begin_s, 1)
        print(json.dumps({"policy": str(checkpoint), "updates": settings.updates, "taken_s": taken_s}))
    else:
        print(checkpoint)
    return 0


def _settings(args: argparse.Namespace) -> TrainSettings:
    from adatracker_deploy.config.schema import parse
    from adatracker_deploy.learning.train.settings import TrainSettings, Variant

    for name in args.variant:
        if name not in get_args(Variant):
            raise UsageError(f"--variant: unknown {name!r}; known are {', '.join(get_args(Variant))}")
    keys = (
        *("recipe", "method", "init", "rate", "updates", "rounds", "round_steps"),
        *("batch", "length", "seed", "bfloat16"),
    )
    given = {key: getattr(args, key) for key in keys if getattr(args, key) is not None}
    return parse(TrainSettings, given | {"variants": sorted(set(args.variant))}, where="train")


class _Progress:
    """A line on stderr now and then: how far, how well, how long still."""

    def __init__(self, updates: int) -> None:
        self._updates = updates
        self._first: int | None = None
        self._begin_s = self._shown_s = time.monotonic()

    def __call__(self, update: int, loss: float) -> None:
        now_s = time.monotonic()
        if self._first is None:
            self._first, self._begin_s = update, now_s
        elif now_s - self._shown_s >= _LINE_EVERY_S:
            self._shown_s = now_s
            rate = (update - self._first) / (now_s - self._begin_s)
            left_min = (self._updates - update) / rate / 60
            line = (
                f"{update} of {self._updates} updates, loss {loss:.3f}, {rate:.2f}/s, {left_min:.0f} min left"
            )
            print(line, file=sys.stderr)
