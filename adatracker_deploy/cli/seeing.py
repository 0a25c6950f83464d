"""Perception options, shared by all commands that use perception."""

from __future__ import annotations

import argparse
from pathlib import Path

from adatracker_deploy.core.onnx_session import PROVIDERS

PROMPT = "person, obstacles"


def add_segmenter_options(group: argparse._ActionsContainer, default: str) -> None:
    """Add the options of perception; `default` says which segmenter is the default."""
    group.add_argument(
        "--segmenter",
        metavar="NAME|FILE",
        help=f"embedded, or a model's .onnx or .yaml (default: {default})",
    )
    group.add_argument(
        "--propagator",
        type=Path,
        metavar="FILE",
        help="SAM2's or EdgeTAM's .yaml: follows the target's mask, also where the segmenter misses it",
    )
    group.add_argument(
        "--prompt",
        metavar="WORDS",
        default=PROMPT,
        help="words that the segmenter looks for (default: %(default)s)",
    )
    group.add_argument(
        "--target",
        metavar="RULE",
        default="ahead",
        help="the person to follow: ahead (whom the robot points at, the nearer the rather), largest, "
        "central, best, #N from the left, X,Y or LEFT,TOP,RIGHT,BOTTOM in fractions of the picture, or "
        "click: whom you click on in the page (default: %(default)s)",
    )


def add_provider_option(group: argparse._ActionsContainer, *, segmenter: bool = True) -> None:
    """Add where the networks of the policy run, and those of a segmenter."""
    of, own = (" and the segmenter", "; for your own segmenter, as in its .yaml") if segmenter else ("", "")
    group.add_argument(
        "--provider",
        choices=PROVIDERS,
        help=f"where the networks of the policy{of} run; an error where it is unavailable "
        f"(default: cpu{own})",
    )


def providers_of(args: argparse.Namespace) -> tuple[str, ...] | None:
    """Return the choice for `open_segmenter`; None where nothing was asked for."""
    return None if args.provider is None else (args.provider,)
