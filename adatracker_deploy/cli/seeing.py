"""Perception options, shared by all commands that use perception."""

from __future__ import annotations

import argparse
from pathlib import Path

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
        help="what the segmenter looks for (default: %(default)s)",
    )
    group.add_argument(
        "--target",
        metavar="RULE",
        default="largest",
        help="who is followed: largest, central, best, #N from the left, X,Y or LEFT,TOP,RIGHT,BOTTOM in "
        "fractions of the picture (default: %(default)s)",
    )
