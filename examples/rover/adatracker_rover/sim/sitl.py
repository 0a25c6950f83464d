"""The simulator: a rover behind a UDP port of this machine, in a process of its own.

`RoverSitl` starts it for a rehearsal; by hand: ``python -m adatracker_rover.sim.sitl --port 5005``.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import socket
import sys
from typing import TYPE_CHECKING

from adatracker_deploy import ROBOT_SILENT, Pacer, UsageError, parse
from adatracker_deploy.sim import (
    FaultCommands,
    ProcessSitl,
    add_arguments,
    announce_ready,
    given_scenario,
    parent_watchdog,
    refuse,
    simulator_clock,
)

from adatracker_rover.sim.firmware import Rover
from adatracker_rover.sim.settings import SitlSettings

if TYPE_CHECKING:
    import threading

    from adatracker_deploy import Clock, Profile, Scenario

RATE_HZ = 50.0
"""Rate of the rover's control loop and of its reports."""
_MOST_DATAGRAMS = 100
"""Read in one turn: a flood must not keep the rover from being driven."""


class RoverSitl(ProcessSitl):
    """Starts the simulator on a free port, whatever the profile's address: rehearsals never collide."""

    module = "adatracker_rover.sim.sitl"
    robot = "simulated rover"
    faults = (ROBOT_SILENT,)

    def start(self, clock: Clock, scenario: Scenario) -> Profile:
        """Start the process; return the profile with its address, and a camera drawn from the rover's pose.

        Raises:
            PlatformError: it did not come up.
        """
        settings = json.dumps(dataclasses.asdict(self._profile.sitl))
        ready = self._process.start(clock, scenario, ["--settings", settings])
        return dataclasses.replace(
            self._profile,
            connection=dataclasses.replace(self._profile.connection, host="127.0.0.1", port=ready["port"]),
            camera=dataclasses.replace(self._profile.camera, uri=f"world://{scenario.scene}"),
        )


def serve(
    rover: Rover,
    wire: socket.socket,
    clock: Clock,
    ended: threading.Event,
    orders: FaultCommands | None = None,
) -> None:
    """Run the rover until `ended` is set and it is at rest; reports go to the last host that asked."""
    orders = orders or FaultCommands()
    wire.setblocking(False)
    pacer = Pacer(clock, RATE_HZ)
    host: tuple[str, int] | None = None
    while not (ended.is_set() and rover.at_rest):
        now_s = pacer.wait().t_ns / 1e9
        with contextlib.suppress(BlockingIOError):
            for _ in range(_MOST_DATAGRAMS):
                data, address = wire.recvfrom(64)
                if rover.receive(data):
                    host = address
        rover.step(now_s)
        if host is not None and ROBOT_SILENT.name not in orders.faults:
            with contextlib.suppress(OSError):  # a host that is gone, or full, misses a report
                wire.sendto(rover.report(), host)


def main(argv: list[str] | None = None) -> int:
    """Run the simulator until its parent ends it; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m adatracker_rover.sim.sitl", description="A simulated rover."
    )
    parser.add_argument("--port", type=int, default=0, help="UDP port on 127.0.0.1; 0 for any free one")
    parser.add_argument("--settings", default="{}", help="the profile's sitl: section, as JSON")
    add_arguments(parser)
    args = parser.parse_args(argv)
    clock = simulator_clock(args)
    try:
        settings = parse(SitlSettings, json.loads(args.settings), where="settings")
        seed = given_scenario(args).seed
        wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        wire.bind(("127.0.0.1", args.port))
    except (UsageError, json.JSONDecodeError, OverflowError) as error:
        return refuse(error)
    except OSError as error:
        return refuse(UsageError(f"UDP port {args.port}: {error.strerror}; give another --port"))
    with wire, contextlib.suppress(KeyboardInterrupt):
        orders = FaultCommands()
        ended = parent_watchdog(args, orders)
        announce_ready(port=wire.getsockname()[1])
        serve(Rover(settings, seed, clock.now_ns() / 1e9, clock.speed), wire, clock, ended, orders)
    return 0


if __name__ == "__main__":
    sys.exit(main())
