"""The simulator process: a trotting robot with a camera that speaks ROS 2 over Zenoh.

``QuadrupedSitl`` starts it for a rehearsal. By hand, for a script or your own ROS 2 nodes::

    python -m adatracker_quadruped.sim.sitl --profile go2 --listen tcp/127.0.0.1:7447

Faults are injected by a name on the key ``sitl/fault`` (`rehearsal_keys.Fault`), or by a command on stdin
(`simulator.FaultCommands`).
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import importlib.util
import json
import random
import re
import secrets
import sys
from typing import TYPE_CHECKING

from adatracker_deploy.config.camera_topic import with_camera, with_robots_camera
from adatracker_deploy.config.schema import parse
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.registry import load_platform, load_profile
from adatracker_deploy.sim.process import (
    FaultCommands,
    ProcessSitl,
    add_arguments,
    announce_ready,
    given_scenario,
    parent_watchdog,
    refuse,
    simulator_clock,
)
from adatracker_quadruped.protocol.rehearsal_keys import ON_DEMAND

if TYPE_CHECKING:
    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.platform import Scenario
    from adatracker_quadruped.sim.simulator import Robot, Simulator

_ANYWHERE = "tcp/127.0.0.1:0"
_LISTEN = re.compile(r"tcp/127\.0\.0\.1:([0-9]{1,5})")
_FAILED = 1
_PORTS = range(20_000, 32_768)
"""Below Linux's ephemeral ports."""
_TRIES = 20


class QuadrupedSitl(ProcessSitl):
    """Starts the simulator at a free port of this machine, whatever robot the profile's endpoint names."""

    module = "adatracker_quadruped.sim.sitl"
    robot = "simulated quadruped"
    faults = ON_DEMAND

    def start(self, clock: Clock, scenario: Scenario) -> Profile:
        """Start the simulator and wait until it is up.

        Raises:
            UsageError: there is no such scene, or the sitl extra is missing.
            PlatformError: the process did not come up.
        """
        _require_mujoco()
        profile = with_robots_camera(self._profile)
        token = secrets.token_hex(16)
        connection = dataclasses.replace(with_camera(profile), tls=None, rehearsal_token=token)
        robot = {
            "connection": dataclasses.asdict(connection),
            "sitl": dataclasses.asdict(profile.sitl),
            "camera_hz": profile.camera.rate_hz,
        }
        ready = self._process.start(clock, scenario, ["--listen", _ANYWHERE, "--robot", json.dumps(robot)])
        return dataclasses.replace(
            profile, connection=dataclasses.replace(connection, endpoint=ready["endpoint"])
        )


def main(argv: list[str] | None = None) -> int:
    """Run the simulator until its parent ends it; return the exit status."""
    args = _arguments().parse_args(argv)
    try:
        orders, robot = FaultCommands(), _robot(args)
        simulator, endpoint = _power_on(robot, args, orders)
    except (UsageError, json.JSONDecodeError) as error:
        return refuse(error)
    except PlatformError as error:
        refuse(error)
        return _FAILED
    lifeline_ended = parent_watchdog(args, orders)
    announce_ready(endpoint=endpoint)
    with contextlib.suppress(KeyboardInterrupt):
        simulator.serve(lifeline_ended)
    return 0


def _robot(args: argparse.Namespace) -> Robot:
    _require_mujoco()
    from adatracker_quadruped.sim.simulator import Robot

    if args.robot:
        return parse(Robot, json.loads(args.robot), where="--robot")
    profile = with_robots_camera(load_profile(args.profile, load_platform("quadruped")))
    connection = dataclasses.replace(with_camera(profile), tls=None)
    return Robot(connection=connection, sitl=profile.sitl, camera_hz=profile.camera.rate_hz)


def _power_on(robot: Robot, args: argparse.Namespace, orders: FaultCommands) -> tuple[Simulator, str]:
    """Return the robot and where it listens; for port 0 that is whichever it can bind itself, and so owns."""
    from adatracker_quadruped.sim.simulator import Simulator

    scenario = given_scenario(args)
    endpoints = [args.listen]
    if args.listen == _ANYWHERE:
        endpoints = [f"tcp/127.0.0.1:{port}" for port in random.SystemRandom().sample(_PORTS, _TRIES)]
    for endpoint in endpoints:
        connection = dataclasses.replace(robot.connection, endpoint=endpoint)
        try:
            there = dataclasses.replace(robot, connection=connection)
            return Simulator(there, scenario, simulator_clock(args), orders), endpoint
        except PlatformError as error:
            taken = error
    raise taken


def _require_mujoco() -> None:
    if importlib.util.find_spec("mujoco") is None:
        raise UsageError("a simulated quadruped needs mujoco: pip install 'adatracker-deploy[sitl]'")


def _loopback(text: str) -> str:
    match = _LISTEN.fullmatch(text)
    if match is None or int(match[1]) >= 2**16:
        raise argparse.ArgumentTypeError(f"{text!r} is not tcp/127.0.0.1:PORT; port 0 is any free one")
    return text


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m adatracker_quadruped.sim.sitl", description="A simulated walking robot."
    )
    parser.add_argument("--profile", default="go2", help="name or file of the robot's profile")
    parser.add_argument(
        "--listen", type=_loopback, default="tcp/127.0.0.1:7447", help="port 0 is any free one"
    )
    parser.add_argument("--robot", default="", help="instead of a profile: a simulator.Robot as JSON")
    add_arguments(parser)
    return parser


if __name__ == "__main__":
    sys.exit(main())
