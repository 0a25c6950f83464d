"""``push``: a policy or trials, to the Hugging Face Hub."""

from __future__ import annotations

import argparse
from pathlib import Path

from adatracker_deploy.cli.extras import need
from adatracker_deploy.core.errors import UsageError


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``push``."""
    parser = commands.add_parser(
        "push",
        help="publish a policy or trials on the Hugging Face Hub",
        description="Publish a policy with its model card at hf://OWNER/NAME, or trials as a dataset at "
        "hf://datasets/OWNER/NAME, in one commit. What is made is private unless --public is given. Trials "
        "tell where and with which command they ran, and what the operator noted.",
    )
    parser.add_argument(
        "what",
        metavar="POLICY|TRIAL",
        nargs="+",
        help="a policy's name or folder; or trials, or their folders",
    )
    parser.add_argument("address", metavar="hf://...[@BRANCH]", help="where to; the branch: main")
    parser.add_argument("--public", action="store_true", help="everybody may see it, if it is made now")
    parser.add_argument(
        "--licence", metavar="SPDX", help="of trials, such as CC-BY-4.0; a policy's is in its manifest"
    )
    parser.add_argument(
        "--with-pictures",
        action="store_true",
        help="publish trials' pictures of real people and places as they were taken: only with their consent",
    )
    parser.add_argument("--message", metavar="WORDS", help="the commit's (default: what it adds)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Check and publish; return the exit status.

    Raises:
        UsageError: it is refused here, or by the Hub.
    """
    from adatracker_deploy.hub.address import parse_address
    from adatracker_deploy.hub.client import publish, read_file
    from adatracker_deploy.publishing.gather import INDEX_NAME, policy_files, trial_files, trials_in

    address = parse_address(args.address)
    need(["hub"], "push")
    if address.kind == "model":
        if len(args.what) > 1:
            raise UsageError(f"{address}: takes one policy; trials go to hf://datasets/OWNER/NAME")
        if trials_in(Path(args.what[0])):
            raise UsageError(
                f"{args.what[0]}: is a trial, or holds some: they go to hf://datasets/OWNER/NAME"
            )
        for option in ("licence", "with_pictures"):
            if getattr(args, option):
                raise UsageError(f"--{option.replace('_', '-')} is for trials: hf://datasets/OWNER/NAME")
        files = policy_files(args.what[0], address)
        message = args.message or f"Policy {Path(args.what[0]).name}"
    else:
        if not args.licence:
            raise UsageError("trials are published under a licence: say which with --licence, as CC-BY-4.0")
        files = trial_files(
            [Path(name) for name in args.what],
            address,
            there=read_file(address, INDEX_NAME),
            licence=args.licence,
            pictures=args.with_pictures,
        )
        count = sum(path.endswith(".mcap") for path in files)
        message = args.message or f"{count} trial{'' if count == 1 else 's'}"
    done = publish(address, files, message=message, public=args.public)
    seen = "private" if done.private else "public"
    print(f"{done.address} ({seen})\n{done.url}")
    return 0
