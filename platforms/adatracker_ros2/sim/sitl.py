"""The simulator process: a base with a camera that speaks ROS 2, on this machine only.

``Ros2Sitl`` starts it for a rehearsal. By hand, for a script or your own nodes::

    python -m adatracker_ros2.sim.sitl --profile ros2_robot --domain 7
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import importlib.util
import json
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
from adatracker_ros2.protocol.connection import Connection
from adatracker_ros2.sim.domain import ReservedDomain
from adatracker_ros2.sim.faults import ON_DEMAND

if TYPE_CHECKING:
    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.platform import Scenario
    from adatracker_ros2.sim.simulator import Robot

_FAILED = 1


class Ros2Sitl(ProcessSitl):
    """Starts the simulator in an empty domain of this machine, whatever robot the profile names."""

    module = "adatracker_ros2.sim.sitl"
    robot = "simulated ROS 2 robot"
    faults = ON_DEMAND
    _domain: ReservedDomain | None = None

    def start(self, clock: Clock, scenario: Scenario) -> Profile:
        """Start the simulator and wait until it is up.

        Raises:
            UsageError: there is no such scene, or the ros2 or sitl extra is missing.
            PlatformError: the process did not come up, or every domain is in use.
        """
        _require()
        profile = with_robots_camera(self._profile)
        self._domain = ReservedDomain()
        connection = dataclasses.replace(
            _alone(with_camera(profile), self._domain.number), rehearsal_token=secrets.token_hex(16)
        )
        robot = {
            "connection": dataclasses.asdict(connection),
            "sitl": dataclasses.asdict(profile.sitl),
            "camera_hz": profile.camera.rate_hz,
        }
        self._process.start(clock, scenario, ["--robot", json.dumps(robot)])
        return dataclasses.replace(profile, connection=connection)

    def close(self) -> None:
        """Tell the process to end, wait until its robot stands, give the domain back; may be called twice."""
        super().close()
        if self._domain is not None:
            self._domain.close()


def _alone(connection: Connection, domain: int) -> Connection:
    """Return a connection that looks for nobody beyond this machine."""
    return dataclasses.replace(connection, domain=domain, discovery="localhost", peers="")


def main(argv: list[str] | None = None) -> int:
    """Run the simulator until its parent ends it; return the exit status."""
    args = _arguments().parse_args(argv)
    try:
        _require()
        from adatracker_ros2.sim.simulator import Simulator

        orders, robot = FaultCommands(), _robot(args)
        simulator = Simulator(robot, given_scenario(args), simulator_clock(args), orders)
    except (UsageError, json.JSONDecodeError) as error:
        return refuse(error)
    except PlatformError as error:
        refuse(error)
        return _FAILED
    lifeline_ended = parent_watchdog(args, orders)
    announce_ready(domain=robot.connection.domain)
    with contextlib.suppress(KeyboardInterrupt):
        simulator.serve(lifeline_ended)
    return 0


def _robot(args: argparse.Namespace) -> Robot:
    from adatracker_ros2.sim.simulator import Robot

    if args.robot:
        return parse(Robot, json.loads(args.robot), where="--robot")
    profile = with_robots_camera(load_profile(args.profile, load_platform("ros2")))
    connection = with_camera(profile)
    domain = connection.domain if args.domain is None else args.domain
    return Robot(connection=_alone(connection, domain), sitl=profile.sitl, camera_hz=profile.camera.rate_hz)


def _require() -> None:
    if importlib.util.find_spec("mujoco") is None:
        raise UsageError("a simulated ROS 2 robot needs mujoco: pip install 'adatracker-deploy[sitl]'")
    if importlib.util.find_spec("rclpy") is None:
        raise UsageError("a simulated ROS 2 robot needs rclpy: pip install 'adatracker-deploy[ros2]'")


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m adatracker_ros2.sim.sitl", description="A simulated ROS 2 robot."
    )
    parser.add_argument("--profile", default="ros2_robot", help="name or file of the robot's profile")
    parser.add_argument("--domain", type=int, default=None, help="ROS_DOMAIN_ID instead of the profile's")
    parser.add_argument("--robot", default="", help="instead of a profile: a simulator.Robot as JSON")
    add_arguments(parser)
    return parser


if __name__ == "__main__":
    sys.exit(main())
