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
        help="the policy; hf://OWNER/NAME@REVISION: on the Hugging Face Hub; ws://HOST:PORT or "
        "wss://HOST:PORT: on another machine; teleop: by hand alone, with --teleop (default: %(default)s)",
    )
    group.add_argument(
        "--instruction",
        metavar="WORDS",
        default="follow the person",
        help="prompt for a policy on another machine that takes one (default: %(default)s)",
    )
    group.add_argument(
        "--teleop",
        nargs="?",
        const="gamepad",
        metavar="DEVICE",
        help="take over by hand: gamepad (default), /dev/input/eventN, keyboard, or a file of events "
        "(docs/teleop.md)",
    )


def driving_policy(args: argparse.Namespace) -> Policy:
    """Load the policy for a robot's loop.

    Raises:
        UsageError: it is refused, or cannot keep up with the rehearsal's speed.
    """
    from adatracker_deploy.policy.by_hand import BY_HAND_NAME, ByHand
    from adatracker_deploy.policy.catalogue import load_policy

    if args.policy == BY_HAND_NAME:
        return ByHand()
    if args.speed not in (None, 1) and is_remote(args.policy):
        raise UsageError("a policy on another machine answers in real time: drop --speed")
    return load_policy(args.policy, args.provider or "cpu", prompt=args.instruction, patience_s=None)


def check_teleop(args: argparse.Namespace) -> None:
    """Check what an operator wants to take over with.

    Raises:
        UsageError: it is not there, or a hand cannot drive in such a run.
    """
    from adatracker_deploy.policy.by_hand import BY_HAND_NAME
    from adatracker_deploy.runtime.teleop.open_hand import check

    if args.teleop is None:
        if args.policy == BY_HAND_NAME:
            raise UsageError(f"--policy {BY_HAND_NAME} drives by hand: say with what, by --teleop DEVICE")
        return
    if args.speed not in (None, 1):
        raise UsageError("a hand drives in the machine's time: drop --speed")
    check(args.teleop)
