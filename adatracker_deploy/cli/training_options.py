"""Options of ``train`` and ``ablate`` that say what is trained."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any, get_args

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from adatracker_deploy.learning.train.settings import TrainSettings

_VARIANTS = ("identification", "dynamics", "consistency", "encoder", "lstm", "last-action", "search")
_KEYS = (
    *("recipe", "method", "front", "belief", "response", "rate", "updates", "critic_updates", "conservative"),
    *("rounds", "round_steps", "batch", "length", "late"),
)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add the options; what is left out keeps the default of `TrainSettings`."""
    parser.add_argument(
        "--recipe",
        metavar="NAME|FILE",
        default="deploy",
        help="the data's recipe, of which visits are drawn; or names of shipped ones, joined by +, one a "
        "visited episode (default: %(default)s)",
    )
    parser.add_argument(
        "--method",
        choices=("dagger", "cloning", "awr", "td3", "cql_sac"),
        default="dagger",
        help="training method (default: %(default)s)",
    )
    parser.add_argument(
        "--variant",
        metavar="NAME",
        action="append",
        default=[],
        help=f"a part to leave out; repeat it for several: {', '.join(f'no-{v}' for v in _VARIANTS)}",
    )
    parser.add_argument(
        "--front",
        choices=("cnn", "pooled"),
        help="what looks at a mask: the paper's convolutions, or fixed statistics and two layers, which "
        "train several times as fast (default: cnn)",
    )
    parser.add_argument(
        "--belief",
        action="store_true",
        help="tell the policy where the target was last seen, and what it drove since",
    )
    parser.add_argument(
        "--response",
        action="store_true",
        help="tell the policy how late the body obeys and what it will still do, as identified on the way",
    )
    parser.add_argument(
        "--late",
        action="store_true",
        help="make a driver for bodies that obey late, by td3 (export-onnx --late)",
    )
    parser.add_argument("--rate", metavar="R", type=float, help="learning rate (default: the method's)")
    parser.add_argument("--updates", metavar="N", type=int, help="updates in all")
    parser.add_argument(
        "--critic-updates", metavar="N", type=int, help="updates of the critics of awr or td3, at first"
    )
    parser.add_argument(
        "--conservative", metavar="W", type=float, help="weight of the conservative term in awr's critics"
    )
    parser.add_argument("--rounds", metavar="N", type=int, help="rounds of visits, of dagger or td3")
    parser.add_argument("--round-steps", metavar="N", type=int, help="steps visited in each round")
    parser.add_argument("--batch", metavar="N", type=int, help="sequences per batch")
    parser.add_argument("--length", metavar="N", type=int, help="steps per sequence")


def settings_of(args: argparse.Namespace, where: str, **more: Any) -> TrainSettings:
    """Return the settings of a run.

    Args:
        args: with what `add_settings` added.
        where: the command, for errors.
        more: further settings; None keeps the default.

    Raises:
        UsageError: an unknown variant, or a number out of range.
    """
    from adatracker_deploy.config.schema import parse
    from adatracker_deploy.learning.train.settings import TrainSettings, Variant

    for name in args.variant:
        if name not in get_args(Variant):
            raise UsageError(f"--variant: unknown {name!r}; known are {', '.join(get_args(Variant))}")
    if args.response and "no-encoder" in args.variant:
        raise UsageError("--response: is part of the context, which --variant no-encoder leaves out")
    asked = {key: getattr(args, key) for key in _KEYS} | more
    given = {key: value for key, value in asked.items() if value is not None}
    return parse(TrainSettings, given | {"variants": sorted(set(args.variant))}, where=where)
