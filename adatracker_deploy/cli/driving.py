"""Options of the policy that drives a robot."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.policy.catalogue import DEFAULT, is_remote

if TYPE_CHECKING:
    from adatracker_deploy.policy.base import Policy


def add_policy_options(group: argparse._ActionsContainer) -> None:
    """Add the options of the policy."""
    group.add_argument(
        "--policy",
        metavar="NAME|DIR|URI",
        default=DEFAULT,
        help="ws://HOST:PORT or wss://HOST:PORT: on another machine (default: %(default)s)",
    )
    group.add_argument(
        "--instruction",
        metavar="WORDS",
        default="follow the person",
        help="told to a policy on another machine, if it wants a prompt (default: %(default)s)",
    )


def driving_policy(args: argparse.Namespace) -> Policy:
    """Load the policy for a robot's loop.

    Raises:
        UsageError: it is refused, or cannot keep up with the rehearsal's speed.
    """
    from adatracker_deploy.policy.catalogue import load_policy

    if args.speed not in (None, 1) and is_remote(args.policy):
        raise UsageError("a policy on another machine answers in the machine's time: drop --speed")
    return load_policy(args.policy, prompt=args.instruction, patience_s=None)
