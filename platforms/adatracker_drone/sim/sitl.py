"""The simulator process: a JSBSim quadrotor that speaks PX4's MAVLink.

``DroneSitl`` starts it for a rehearsal. By hand, for a ground station or your own script::

    python -m adatracker_drone.sim.sitl --port 14540 --gcs udpout:127.0.0.1:14550

It sends to the given UDP port of this machine from a port of its own, as PX4's simulator does.

A rehearsal cannot reach anything else. Both ports are chosen anew, whatever the profile says; each end
talks only to the other's port; and the simulator has a random uid for this run, without which the adapter
arms nothing. Any other sender on the link ends the rehearsal.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import importlib.util
import ipaddress
import json
import platform as machine
import re
import secrets
import socket
import sys
from typing import TYPE_CHECKING

from adatracker_deploy.config.schema import parse
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.faults import BATTERY_LOW, LINK_DROP, ROBOT_SILENT, TAKEOVER
from adatracker_deploy.core.ports import unused_port
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
from adatracker_drone.protocol.signing import read_key
from adatracker_drone.sim.settings import SitlSettings

if TYPE_CHECKING:
    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.platform import Scenario
    from adatracker_drone.sim.simulator import Simulator

STOP_TIMEOUT_S = 65.0
"""The simulator gives up on coming to rest a little sooner by itself (`simulator.LINGER_S`)."""
UID_BYTES = 18
"""Length of uid2 in AUTOPILOT_VERSION."""
_GCS = re.compile(r"udpout:([0-9.]+):(\d+)")


class DroneSitl(ProcessSitl):
    """Starts the simulator on its own link; the profile's ``connection.url`` is not used.

    Its end takes no command: a vehicle still in the air lands by its link or by its own fail-safe, within a
    minute.
    """

    module = "adatracker_drone.sim.sitl"
    robot = "simulated drone"
    stop_timeout_s = STOP_TIMEOUT_S
    faults = (LINK_DROP, ROBOT_SILENT, BATTERY_LOW, TAKEOVER)
    """The faults it supports; its camera is rendered in the tracker, and freezes there."""

    def start(self, clock: Clock, scenario: Scenario) -> Profile:
        """Start the simulator and wait until it is up; the world is drawn elsewhere, by the drone's pose.

        Raises:
            UsageError: the sitl extra is missing, or a setting cannot be.
            PlatformError: the process did not come up.
        """
        _require_libraries()
        port, uid = unused_port(socket.SOCK_DGRAM), secrets.token_hex(UID_BYTES)
        settings = json.dumps(dataclasses.asdict(self._profile.sitl))
        connection = self._profile.connection
        ready = self._process.start(
            clock,
            scenario,
            [
                *("--port", str(port), "--settings", settings, "--uid", uid),
                *("--system-id", str(connection.system_id)),
                *(("--signing-key", connection.signing_key) if connection.signing_key else ()),
            ],
        )
        connection = dataclasses.replace(
            connection,
            url=f"udpin://127.0.0.1:{port}",
            peer=f"127.0.0.1:{ready['source']}",
            uid=uid,
            alone=True,
        )
        camera = dataclasses.replace(self._profile.camera, uri=f"world://{scenario.scene}")
        return dataclasses.replace(self._profile, connection=connection, camera=camera)


def main(argv: list[str] | None = None) -> int:
    """Run the simulator until its parent ends it; return the exit status."""
    args = _arguments().parse_args(argv)
    try:
        settings = parse(SitlSettings, json.loads(args.settings), where="settings")
        gcs = _gcs_address(args.gcs or settings.gcs)
        key = read_key(args.signing_key) if args.signing_key else None
        orders = FaultCommands()
        addresses = [("127.0.0.1", args.port), *gcs]
        simulator = _power_on(settings, args, addresses, key, orders)
    except (UsageError, json.JSONDecodeError) as error:
        return refuse(error)
    lifeline_ended = parent_watchdog(args, orders)
    announce_ready(port=args.port, source=simulator.source_port, gcs=gcs)
    with contextlib.suppress(KeyboardInterrupt):
        simulator.serve(simulator_clock(args), lifeline_ended)
    return 0


def _power_on(
    settings: SitlSettings,
    args: argparse.Namespace,
    addresses: list[tuple[str, int]],
    key: bytes | None,
    orders: FaultCommands,
) -> Simulator:
    _require_libraries()
    from adatracker_drone.sim.autopilot import Identity
    from adatracker_drone.sim.simulator import Simulator

    identity = Identity(args.system_id, bytes.fromhex(args.uid))
    seed = given_scenario(args).seed
    return Simulator(settings, seed, args.speed, addresses, key=key, orders=orders, identity=identity)


def _require_libraries() -> None:
    for library in ("jsbsim", "pymavlink"):
        if importlib.util.find_spec(library) is None:
            how = "pip install 'adatracker-deploy[sitl]'"
            if library == "jsbsim" and machine.machine() == "aarch64":  # which that extra leaves out there
                how = "pip install jsbsim (it has no wheel for aarch64; cmake and a compiler build it)"
            raise UsageError(f"a simulated drone needs {library}: {how}")


def _gcs_address(text: str) -> list[tuple[str, int]]:
    if not text:
        return []
    match = _GCS.fullmatch(text)
    try:
        if match is None:
            raise ValueError
        return [(str(ipaddress.IPv4Address(match[1])), _port(match[2]))]
    except (ValueError, argparse.ArgumentTypeError):
        raise UsageError(
            f"gcs {text!r}: expected udpout:ADDRESS:PORT, for example udpout:127.0.0.1:14550"
        ) from None


def _port(text: str) -> int:
    if not text.isdecimal() or not 0 < int(text) < 2**16:
        raise argparse.ArgumentTypeError(f"{text!r} is not a UDP port (1 to 65535)")
    return int(text)


def _uid(text: str) -> str:
    if not re.fullmatch(f"[0-9a-f]{{{2 * UID_BYTES}}}", text):
        raise argparse.ArgumentTypeError(f"{text!r} is not {2 * UID_BYTES} hexadecimal digits")
    return text


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m adatracker_drone.sim.sitl", description="A simulated PX4 drone."
    )
    parser.add_argument("--port", type=_port, default=14540, help="UDP port of this machine to send to")
    parser.add_argument("--gcs", default="", help="a second link: udpout:ADDRESS:PORT")
    parser.add_argument(
        "--signing-key", default="", help="a file of 32 bytes, mode 0600: sign, and hear nothing unsigned"
    )
    parser.add_argument("--system-id", type=int, default=1, help="MAV_SYS_ID")
    parser.add_argument("--uid", type=_uid, default="00" * UID_BYTES, help="36 hexadecimal digits")
    parser.add_argument("--settings", default="{}", help="the profile's sitl: section, as JSON")
    add_arguments(parser)
    return parser


if __name__ == "__main__":
    sys.exit(main())
