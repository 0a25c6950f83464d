"""``serve``: a policy for robots elsewhere."""

from __future__ import annotations

import argparse
import os
import sys
from functools import partial
from pathlib import Path

from adatracker_deploy.cli.extras import need
from adatracker_deploy.cli.ranges import whole
from adatracker_deploy.cli.seeing import add_provider_option
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.policy.catalogue import DEFAULT, TOKEN


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``serve``."""
    parser = commands.add_parser(
        "serve",
        help="serve a policy to robots elsewhere",
        description="Serve a policy by openpi's protocol; robots use it with --policy ws://HOST:PORT. "
        f"With {TOKEN} in the environment, only clients that send the same token are served.",
    )
    add_provider_option(parser, segmenter=False)
    parser.add_argument(
        "--policy",
        metavar="NAME|DIR|URI",
        default=DEFAULT,
        help="the policy; hf://OWNER/NAME@REVISION: on the Hugging Face Hub (default: %(default)s)",
    )
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="address to listen on (default: this machine only)",
    )
    parser.add_argument(
        "--port",
        type=whole(0, 65535),
        default=8000,
        metavar="N",
        help="port to listen on (default: %(default)s; 0: any free one)",
    )
    parser.add_argument("--certificate", type=Path, metavar="PEM", help="serve wss:// with this certificate")
    parser.add_argument("--key", type=Path, metavar="PEM", help="its private key")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Serve until Ctrl-C.

    Raises:
        UsageError: the policy or the certificate is refused, or the address cannot be listened on.
    """
    from adatracker_deploy.policy.catalogue import is_remote, load_policy, pinned

    if (args.certificate is None) != (args.key is None):
        raise UsageError("--certificate and --key go together")
    if is_remote(args.policy):
        raise UsageError("serve is for policies of this machine: point the robot at that server itself")
    need(["remote"], "serve")
    from adatracker_deploy.policy.server import served

    server = served(
        partial(load_policy, pinned(args.policy), args.provider or "cpu"),
        host=args.host,
        port=args.port,
        token=os.environ.get(TOKEN, ""),
        certificate=args.certificate,
        key=args.key,
    )
    with server:
        host, port = server.socket.getsockname()[:2]
        shown = f"[{host}]" if ":" in host else host
        print(f"{'wss' if args.certificate else 'ws'}://{shown}:{port}", flush=True)
        print("Ctrl-C ends it", file=sys.stderr)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            return 0
    return 0
