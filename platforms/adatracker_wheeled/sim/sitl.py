"""The simulator process: a base in a world, behind a socketcand.

``WheeledSitl`` starts it for a rehearsal. By hand, for your own script or tool::

    python -m adatracker_wheeled.sim.sitl --profile scout --port 28700
    python -m adatracker_wheeled.sim.sitl --profile scout --interface socketcan --channel vcan0

`faults` describes how to inject faults while it runs, on the bus or by a command on stdin
(`simulator.FaultCommands`); any browser shows its camera.
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

from adatracker_deploy.config.schema import parse
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.faults import LINK_DROP
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
from adatracker_wheeled.protocol.connection import Connection
from adatracker_wheeled.sim.faults import ON_DEMAND
from adatracker_wheeled.sim.settings import SitlSettings

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.platform import Scenario
    from adatracker_wheeled.protocol.frames import CanFrame
    from adatracker_wheeled.sim.simulator import Simulator

STOP_TIMEOUT_S = 15.0
"""The simulator gives up on coming to rest a little sooner by itself (`simulator.LINGER_S`)."""
CHANNEL = "can0"
"""The bus's name behind the simulated socketcand; it takes any."""


class WheeledSitl(ProcessSitl):
    """Starts the simulator on free ports."""

    module = "adatracker_wheeled.sim.sitl"
    robot = "simulated base"
    stop_timeout_s = STOP_TIMEOUT_S
    faults = ON_DEMAND

    def start(self, clock: Clock, scenario: Scenario) -> Profile:
        """Start the simulator and wait until it is up; its camera shows its own world.

        Raises:
            UsageError: the profile cannot be simulated, or the sitl extra is missing.
            PlatformError: the process did not come up.
        """
        _require_libraries()
        profile = self._profile
        token = secrets.token_hex(16)
        ready = self._process.start(
            clock,
            scenario,
            [
                *("--rehearsal-token", token),
                *("--connection", json.dumps(dataclasses.asdict(profile.connection))),
                *("--settings", json.dumps(dataclasses.asdict(profile.sitl))),
                *("--camera-rate-hz", str(profile.camera.rate_hz)),
            ],
        )
        connection = dataclasses.replace(
            profile.connection,
            interface="socketcand",
            channel=CHANNEL,
            host="127.0.0.1",
            port=ready["port"],
            rehearsal_token=token,
        )
        camera = dataclasses.replace(profile.camera, uri=ready["camera"])
        return dataclasses.replace(profile, connection=connection, camera=camera)


def main(argv: list[str] | None = None) -> int:
    """Run the simulator until its parent ends it; return the exit status."""
    args = _arguments().parse_args(argv)
    try:
        _require_libraries()
        return _run(args)
    except (UsageError, PlatformError, json.JSONDecodeError) as error:
        return refuse(error)


def _run(args: argparse.Namespace) -> int:
    from adatracker_wheeled.sim.camera import FailingCamera
    from adatracker_wheeled.sim.simulator import Simulator

    _check_ports(args)
    connection, settings, rate_hz = _described(args)
    clock = simulator_clock(args)
    orders = FaultCommands()
    ended = parent_watchdog(args, orders)
    with contextlib.ExitStack() as stack:
        simulator = Simulator(connection.roles, settings, given_scenario(args), clock, orders)
        send, port = _bus(args, connection, simulator, orders, stack)
        camera = FailingCamera(args.camera_port, simulator.rehearsal.go)
        stack.callback(camera.close)
        orders.listen(camera.apply_faults)
        simulator.rehearsal.film(clock, rate_hz, camera.publish, ended)
        announce_ready(port=port, camera=camera.url)
        stack.enter_context(contextlib.suppress(KeyboardInterrupt))
        simulator.serve(send, ended)
    return 0


def _check_ports(args: argparse.Namespace) -> None:
    for option, port in (("--port", args.port), ("--camera-port", args.camera_port)):
        if not 0 <= port <= 65535:
            raise UsageError(f"{option} {port}: expected 0 to 65535")


def _described(args: argparse.Namespace) -> tuple[Connection, SitlSettings, float]:
    """Return the base by its two sections, or by the profile that was named."""
    if args.connection is None or args.settings is None:
        profile = load_profile(args.profile, load_platform("wheeled"))
        return profile.connection, profile.sitl, args.camera_rate_hz or profile.camera.rate_hz
    return (
        parse(Connection, json.loads(args.connection), where="connection"),
        parse(SitlSettings, json.loads(args.settings), where="sitl"),
        args.camera_rate_hz,
    )


def _bus(
    args: argparse.Namespace,
    connection: Connection,
    simulator: Simulator,
    orders: FaultCommands,
    stack: contextlib.ExitStack,
) -> tuple[Callable[[CanFrame], object], int]:
    """Return how the base puts frames on its bus, and the TCP port of that bus, if it has one."""
    if args.interface:
        from adatracker_wheeled.protocol.bus import Bus

        on_it = dataclasses.replace(connection, interface=args.interface, channel=args.channel)
        bus = Bus.open(on_it, lambda frame: simulator.hear(frame) if frame else None)
        stack.callback(bus.close)
        return bus.send, 0
    from adatracker_wheeled.sim.socketcand import SocketcandServer

    try:
        server = SocketcandServer(args.port, simulator.hear, args.rehearsal_token)
    except OSError as error:
        raise UsageError(f"TCP port {args.port}: {error.strerror}; give another with --port") from error
    stack.callback(server.close)
    orders.listen(lambda faults: server.cut(LINK_DROP.name in faults))
    return server.send, server.port


def _require_libraries() -> None:
    if importlib.util.find_spec("mujoco") is None:
        raise UsageError("a simulated base needs mujoco: pip install 'adatracker-deploy[sitl]'")


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m adatracker_wheeled.sim.sitl", description="A simulated wheeled base."
    )
    parser.add_argument("--profile", default="scout", help="the base: a name or a file")
    parser.add_argument("--port", type=int, default=0, help="of its socketcand; 0 takes any free one")
    parser.add_argument(
        "--interface", default="", help="put it on a bus of python-can's instead: socketcan ..."
    )
    parser.add_argument("--channel", default="vcan0", help="of that bus")
    parser.add_argument("--camera-port", type=int, default=0, help="of its camera's stream")
    parser.add_argument("--camera-rate-hz", type=float, default=None, help="default: the profile's")
    parser.add_argument("--rehearsal-token", default="", help="the answer to < rehearsal >")
    parser.add_argument("--connection", help="the profile's connection: section, as JSON")
    parser.add_argument("--settings", help="the profile's sitl: section, as JSON")
    add_arguments(parser)
    return parser


if __name__ == "__main__":
    sys.exit(main())
