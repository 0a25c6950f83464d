"""``platforms``, ``profiles``, ``policies``, ``scenes``: what there is."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the four listing commands."""
    listings: dict[str, tuple[str, Callable[[], dict[str, str]]]] = {
        "platforms": ("the robots that are installed", _platforms),
        "profiles": ("the robot profiles that can be named", _profiles),
        "policies": ("the policies that can be named", _policies),
        "scenes": ("the virtual worlds", _scenes),
    }
    for name, (what, rows) in listings.items():
        parser = commands.add_parser(name, help=f"list {what}", description=f"List {what}.")
        parser.add_argument("--json", action="store_true", help="print one JSON object on stdout")
        parser.set_defaults(run=lambda args, name=name, rows=rows: _show(name, rows(), args.json))


def _show(name: str, rows: dict[str, str], as_json: bool) -> int:
    if as_json:
        print(json.dumps({name: rows}))
        return 0
    width = max(map(len, rows), default=0)
    for key, text in rows.items():
        print(f"{key:<{width}}  {text}".rstrip())
    return 0


def _platforms() -> dict[str, str]:
    from adatracker_deploy.registry import load_platform, platform_names

    def line(name: str) -> str:
        try:
            platform = load_platform(name)
        except UsageError as error:
            return f"unusable: {error}"
        return f"follows {', '.join(sorted(platform.axes))}; default profile {platform.default_profile}"

    return {name: line(name) for name in platform_names()}


def _profiles() -> dict[str, str]:
    from adatracker_deploy.registry import load_profile, profile_names

    def line(name: str) -> str:
        try:
            profile = load_profile(name)
        except UsageError as error:
            return f"unusable: {error}"
        return f"{profile.platform}: {profile.description}"

    return {name: line(name) for name in profile_names()}


def _policies() -> dict[str, str]:
    from adatracker_deploy.policy.catalogue import describe_policies

    return describe_policies()


def _scenes() -> dict[str, str]:
    from adatracker_deploy.sim import describe_scenes

    return describe_scenes()
