"""``layout``: ready-made panels for Foxglove."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``layout``."""
    parser = commands.add_parser(
        "layout",
        help="write Foxglove's layout for trials",
        description="Write a layout for Foxglove to stdout, for --live and for a trial's trial.mcap: "
        "adatracker-deploy layout > layout.json; then Layouts, Import from file.",
    )
    parser.set_defaults(run=run)


def run(_args: argparse.Namespace) -> int:
    """Write it; return the exit status."""
    from adatracker_deploy.trial.live_layout import live_layout

    print(live_layout(), end="")
    return 0
