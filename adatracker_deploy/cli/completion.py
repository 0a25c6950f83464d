"""``completion``: what a shell needs to complete this command."""

from __future__ import annotations

import argparse
from pathlib import Path

from adatracker_deploy.core.errors import UsageError

_WHERE = {
    "bash": "~/.local/share/bash-completion/completions/adatracker-deploy",
    "zsh": "a folder of $fpath, as _adatracker-deploy",
    "fish": "~/.config/fish/completions/adatracker-deploy.fish",
}


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``completion``."""
    parser = commands.add_parser(
        "completion",
        help="write the completion for a shell",
        description="Write a completion script to stdout. It belongs in: "
        + "; ".join(f"{shell}: {place}" for shell, place in _WHERE.items()),
    )
    parser.add_argument("shell", choices=tuple(_WHERE))
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the script; return the exit status.

    Raises:
        UsageError: the library is not installed.
    """
    try:
        import shtab
    except ImportError as error:
        raise UsageError("completion needs shtab: pip install 'adatracker-deploy[completion]'") from error
    from adatracker_deploy.cli import _parser

    parser = _parser(with_commands=True)
    _name_files(parser, shtab.FILE)
    print(shtab.complete(parser, args.shell))
    return 0


def _name_files(parser: argparse.ArgumentParser, pattern: object) -> None:
    """Mark all arguments that are paths, also the subcommands'."""
    for action in parser._actions:  # argparse has no other way to its arguments
        if isinstance(action, argparse._SubParsersAction):
            for inner in action.choices.values():
                _name_files(inner, pattern)
        elif action.type is Path:
            action.complete = pattern  # type: ignore[attr-defined]
