"""Sets up an autopilot for offboard flight: shows which parameters it would write, asks, writes, reads back.

    python -m adatracker_drone.adapter.set_up --profile px4_quad

Nothing is written unless somebody at a terminal says yes to what is shown, and never to an armed drone.
"""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.registry import load_platform, load_profile
from adatracker_drone.adapter.adapter import DroneAdapter
from adatracker_drone.adapter.parameter_changes import proposed

if TYPE_CHECKING:
    from collections.abc import Callable


def set_up(drone: DroneAdapter, agree: Callable[[str], bool], show: Callable[[str], None]) -> bool:
    """Bring a connected drone's parameters to what the preflight asks for; return whether they now are.

    Args:
        drone: connected.
        agree: asks a question; nothing is written unless it returns True.
        show: shows a line.

    Raises:
        PlatformError: the drone is armed, or did not take a parameter.
    """
    changes = proposed(drone.parameters())
    if not changes:
        show("the autopilot's parameters are as they should be; nothing to write")
        return True
    for change in changes:
        show(str(change))
    if not agree(f"Write {'this parameter' if len(changes) == 1 else f'these {len(changes)} parameters'}?"):
        show("nothing was written")
        return False
    drone.write_parameters(changes)
    show(f"written and read back: {', '.join(change.name for change in changes)}")
    return True


def main(argv: list[str] | None = None) -> int:
    """Run the command; return the exit status: 0 as they should be, 1 not so, 2 a wrong request."""
    parser = argparse.ArgumentParser(
        prog="python -m adatracker_drone.adapter.set_up",
        description="Show which of a PX4's parameters should change, and write them if you agree.",
    )
    parser.add_argument("--profile", default="px4_quad", help="name or file; default %(default)s")
    args = parser.parse_args(argv)
    try:
        platform = load_platform("drone")
        profile = load_profile(args.profile, platform)
        if not sys.stdin.isatty():
            raise UsageError("parameters are written only after you have agreed: run this at a terminal")
        with platform(profile, MonotonicClock()) as drone:
            drone.connect()
            assert isinstance(drone, DroneAdapter)
            return 0 if set_up(drone, _agree, print) else 1
    except (UsageError, PlatformError) as error:
        print(f"adatracker-deploy: {error}", file=sys.stderr)
        return 2 if isinstance(error, UsageError) else 1


def _agree(question: str) -> bool:
    return input(f"{question} [y/N] ").strip().lower() in ("y", "yes")


if __name__ == "__main__":
    sys.exit(main())
