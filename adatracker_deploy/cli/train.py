"""``train``: a policy, from collected data or logged trials."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.cli.counting import Count
from adatracker_deploy.cli.training_options import add_settings, settings_of
from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from adatracker_deploy.learning.train.curves import MetricLogger
    from adatracker_deploy.learning.train.settings import TrainSettings


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``train``."""
    parser = commands.add_parser(
        "train",
        help="train a policy",
        description="Train a policy on collected data or logged trials; the run can be interrupted and "
        "resumed.",
    )
    parser.add_argument(
        "--data",
        metavar="DIR",
        type=Path,
        action="append",
        required=True,
        help="a folder of shards or of logged trials, or of such folders",
    )
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="the run's folder")
    add_settings(parser)
    parser.add_argument(
        "--init", metavar="RUN|BUNDLE", help="start from the weights in another run's folder, or of a bundle"
    )
    parser.add_argument("--seed", metavar="S", type=int, help="seed (default: 0)")
    parser.add_argument("--device", default="cpu", help="cpu, cuda or cuda:1 (default: %(default)s)")
    cores = len(os.sched_getaffinity(0))
    parser.add_argument(
        "--threads",
        metavar="N",
        type=int,
        default=cores,
        help="threads of torch on the CPU (default: %(default)s)",
    )
    parser.add_argument(
        "--workers", metavar="N", type=int, default=cores, help="processes that visit (default: %(default)s)"
    )
    parser.add_argument("--bfloat16", action="store_true", help="compute in bfloat16 where that is faster")
    parser.add_argument("--resume", action="store_true", help="resume the run in --out")
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object as the only line of stdout"
    )
    parser.add_argument(
        "--mlflow", metavar="URI", help="log the curves there, too: sqlite:///mlflow.db, http://HOST:PORT"
    )
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
    settings = settings_of(args, "train", init=args.init, seed=args.seed, bfloat16=args.bfloat16)
    begin_s = time.monotonic()
    with Count("updates") as count:
        checkpoint = train(
            settings,
            args.data,
            args.out,
            resume=args.resume,
            device=args.device,
            workers=args.workers,
            say=count.say,
            tell=lambda update, loss: count(update, settings.updates, f", loss {loss:.3f}"),
            open_loggers=lambda: [_mlflow(args, settings)] if args.mlflow else [],
        )
    if args.json:
        taken_s = round(time.monotonic() - begin_s, 1)
        print(json.dumps({"policy": str(checkpoint), "updates": settings.updates, "taken_s": taken_s}))
    else:
        print(checkpoint)
    return 0


def _mlflow(args: argparse.Namespace, settings: TrainSettings) -> MetricLogger:
    from dataclasses import asdict

    from adatracker_deploy.learning.train.mlflow_run import MlflowRun

    said = {name: str(value) for name, value in asdict(settings).items()}
    return MlflowRun(args.mlflow, args.out, said, say=lambda text: print(text, file=sys.stderr))
