"""``replay``: a trial's policy and gate again, over what was logged."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from adatracker_deploy.cli.seeing import add_provider_option
from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from adatracker_deploy.policy.base import Policy
    from adatracker_deploy.replay.trial_again import PolicyAgain
    from adatracker_deploy.trial.reader import Trial


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``replay``."""
    parser = commands.add_parser(
        "replay",
        help="re-run a trial's policy, or another, on the logged inputs",
        description="Re-run a policy on a trial's logged observations, and compare action and z tick by "
        "tick. The same bundle on the same machine gives bit-identical answers. Exit status 1 if the trial's "
        "own policy answers differently, else 0; another bundle is expected to differ. Nothing moves.",
    )
    parser.add_argument("trial", metavar="TRIAL", type=Path, help="a trial's folder, or its trial.mcap")
    parser.add_argument(
        "--policy", metavar="NAME|DIR|URI", help="re-run this policy (default: the one that the log names)"
    )
    add_provider_option(parser, segmenter=False)
    parser.add_argument(
        "--profile",
        metavar="NAME|FILE",
        help="also pass the logged commands through the gate with this profile's limits",
    )
    parser.add_argument("--plot", metavar="PNG", type=Path, help="plot the logged and the new commands here")
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object as the only line of stdout"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Replay; return the exit status.

    Raises:
        UsageError: it is not a trial, it has nothing to replay, the policy or the profile is refused, or
            the picture cannot be written.
    """
    from rich.console import Console

    from adatracker_deploy.registry import load_limits
    from adatracker_deploy.replay.trial_again import ask_again, gate_again
    from adatracker_deploy.replay.view import gate_record, gate_view, policy_record, policy_view
    from adatracker_deploy.trial.aftermath import aftermath_of
    from adatracker_deploy.trial.reader import read_trial

    limits = None if args.profile is None else load_limits(args.profile)
    trial = read_trial(args.trial)
    again = ask_again(trial, _policy(args.policy, trial, args.provider or "cpu"))
    judged = None if limits is None else gate_again(trial, limits)
    after = None
    if trial.summary is None:  # the log ended before its trial
        after = aftermath_of(trial.path.parent, trial.steps[-1].t_ns if trial.steps else None)
    if args.plot is not None:
        _draw(args.plot, again)
    if args.json:
        record: dict[str, Any] = {"trial": str(trial.path.parent), **policy_record(again)}
        if judged is not None:
            record["gate"] = gate_record(judged)
        if after is not None:
            record["after_log"] = dataclasses.asdict(after)
        print(json.dumps(record, allow_nan=False))
    else:
        console = Console(highlight=False)
        console.print(policy_view(again), soft_wrap=True)
        if judged is not None:
            console.print(gate_view(judged), soft_wrap=True)
        if after is not None:
            console.print(after.summary, markup=False, soft_wrap=True)
        if args.plot is not None:
            console.print(str(args.plot), markup=False, soft_wrap=True)
    own = args.policy is None or again.same is not False
    return 1 if own and again.first is not None else 0


def _policy(named: str | None, trial: Trial, provider: str) -> Policy:
    from adatracker_deploy.policy.catalogue import load_policy

    if named is not None:
        return load_policy(named, provider)
    try:
        if "/" in trial.policy:  # a name is not a path
            raise UsageError(f"unknown policy {trial.policy!r}")
        return load_policy(trial.policy, provider)
    except UsageError as error:
        where = _source(trial) or "DIR"
        raise UsageError(
            f"{error}; the log names it: say where its bundle is with --policy {where}"
        ) from error


def _source(trial: Trial) -> str:
    """Return where on the Hub the log says its policy is from: to be shown, not fetched, for logs travel."""
    from adatracker_deploy.hub.address import parse_address

    said = trial.config.get("policy_source") if isinstance(trial.config, Mapping) else None
    with contextlib.suppress(UsageError):
        return str(parse_address(str(said or "")))
    return ""


def _draw(path: Path, again: PolicyAgain) -> None:
    import cv2

    from adatracker_deploy.replay.plot import command_plot

    times_ns = [answer.step.t_ns for answer in again.replayed.answers]
    picture = command_plot([(t_ns - times_ns[0]) / 1e9 for t_ns in times_ns], again.logged, again.asked)
    _, png = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    try:
        path.write_bytes(png.tobytes())
    except OSError as error:
        raise UsageError(f"--plot {path}: cannot be written ({error.strerror})") from error
