"""The simulated far end: a JSBSim quadrotor behind PX4's dialect of MAVLink, in a process of its own.

``DroneSitl`` starts it for a rehearsal. By hand, for a ground station or a script of one's own::

    python -m adatracker_drone.sitl --port 14540 --gcs udpout:127.0.0.1:14550

It sends to the given UDP port of this machine from a port of its own, as PX4's simulator does.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import importlib.util
import ipaddress
import json
import re
import socket
import subprocess
import sys
import threading
import time
from typing import TYPE_CHECKING

from adatracker_deploy.errors import PlatformError, UsageError
from adatracker_deploy.platform import Sitl
from adatracker_deploy.runtime.clock import MonotonicClock
from adatracker_deploy.schema import parse
from adatracker_drone.protocol import check_url
from adatracker_drone.settings import SitlSettings

if TYPE_CHECKING:
    from adatracker_deploy.profile import Profile
    from adatracker_deploy.runtime.clock import Clock
    from adatracker_drone.far_end import FarEnd

START_TIMEOUT_S = 20.0
STOP_TIMEOUT_S = 65.0
"""The far end gives up on coming to rest a little sooner by itself (`far_end.LINGER_S`)."""
_ASKED_WRONG = 2
"""Exit status of settings that cannot be."""
_ANY_PORT = re.compile(r"(udpin://127\.0\.0\.1):0")
_GCS = re.compile(r"udpout:([0-9.]+):(\d+)")


class DroneSitl(Sitl):
    """Starts the far end behind a profile's ``udpin://`` URL; port 0 there means any free one."""

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        self._process: subprocess.Popen[str] | None = None

    def start(self, clock: Clock, seed: int) -> Profile:
        """Start the far end and wait until it is up.

        Raises:
            UsageError: the port is in use, the URL is no ``udpin://``, or the sitl extra is missing.
            PlatformError: the process did not come up.
        """
        _require_libraries()
        url, port = _free_address(self._profile.connection.url)
        settings = json.dumps(dataclasses.asdict(self._profile.sitl))
        epoch_ns = clock.epoch_ns if isinstance(clock, MonotonicClock) else time.monotonic_ns()
        self._process = subprocess.Popen(
            [
                *(sys.executable, "-m", "adatracker_drone.sitl", "--lifeline"),
                *("--port", str(port), "--seed", str(seed), "--settings", settings),
                *("--speed", repr(clock.speed), "--epoch-ns", str(epoch_ns)),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # a Ctrl-C in the terminal must not take the vehicle out of the air
        )
        self._await_ready(self._process)
        connection = dataclasses.replace(self._profile.connection, url=url)
        return dataclasses.replace(self._profile, connection=connection)

    def close(self) -> None:
        """End the lifeline and wait: the process ends once the vehicle has landed, or after a minute.

        Nothing takes command here: a vehicle still in the air lands by its link or by its own fail-safe.
        """
        process, self._process = self._process, None
        if process is None or process.stdin is None or process.stdout is None:
            return
        process.stdin.close()
        try:
            process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stdout.close()

    def _await_ready(self, process: subprocess.Popen[str]) -> None:
        """Wait for the one line that says that the far end is up."""
        assert process.stdout is not None
        timer = threading.Timer(START_TIMEOUT_S, process.kill)
        timer.start()
        try:
            line = process.stdout.readline()
        finally:
            timer.cancel()
        if not line.startswith('{"ready"'):
            self.close()
            if process.returncode == _ASKED_WRONG:
                raise UsageError(line.strip())
            raise PlatformError(f"the simulated drone did not start: {line.strip() or 'see its error above'}")


def _free_address(url: str) -> tuple[str, int]:
    """Return the URL and its UDP port, which nobody else has bound.

    Raises:
        UsageError: it is in use; without this look two programs would share it, and each miss half.
    """
    if match := _ANY_PORT.fullmatch(url):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        return f"{match[1]}:{port}", port
    address = check_url(url)
    if address is None:
        raise UsageError(f"connection.url {url!r}: a simulated drone is reached by udpin://127.0.0.1:PORT")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(address)
        except OSError as error:
            raise UsageError(
                f"UDP port {address[1]} is in use: stop the program that holds it (a ground station, another "
                "rehearsal), or give another connection.url in the profile"
            ) from error
    return url, address[1]


def main(argv: list[str] | None = None) -> int:
    """Run the far end until it is told to end; return the exit status."""
    args = _arguments().parse_args(argv)
    try:
        settings = parse(SitlSettings, json.loads(args.settings), where="settings")
        gcs = _gcs_address(args.gcs or settings.gcs)
        far_end = _power_on(settings, args.seed, args.speed, [("127.0.0.1", args.port), *gcs])
    except (UsageError, json.JSONDecodeError) as error:
        print(error, flush=True)
        return _ASKED_WRONG
    lifeline_ended = threading.Event()
    if args.lifeline:
        threading.Thread(target=_outlive_stdin, args=(lifeline_ended,), daemon=True).start()
    print(json.dumps({"ready": {"port": args.port, "gcs": gcs}}), flush=True)
    with contextlib.suppress(KeyboardInterrupt):
        far_end.serve(MonotonicClock(args.speed, args.epoch_ns), lifeline_ended)
    return 0


def _power_on(settings: SitlSettings, seed: int, speed: float, addresses: list[tuple[str, int]]) -> FarEnd:
    _require_libraries()
    from adatracker_drone.far_end import FarEnd

    return FarEnd(settings, seed, speed, addresses)


def _require_libraries() -> None:
    for library in ("jsbsim", "pymavlink"):
        if importlib.util.find_spec(library) is None:
            raise UsageError(f"a simulated drone needs {library}: pip install 'adatracker-deploy[sitl]'")


def _outlive_stdin(ended: threading.Event) -> None:
    sys.stdin.read()
    ended.set()


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


def _speed(text: str) -> float:
    if not 0.05 <= float(text) <= 50:
        raise argparse.ArgumentTypeError(f"{text} is not between 0.05 and 50")
    return float(text)


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m adatracker_drone.sitl", description="A simulated PX4 drone."
    )
    parser.add_argument("--port", type=_port, default=14540, help="UDP port of this machine to send to")
    parser.add_argument("--gcs", default="", help="a second link: udpout:ADDRESS:PORT")
    parser.add_argument("--seed", type=int, default=0, help="of estimation errors and wind")
    parser.add_argument("--settings", default="{}", help="the profile's sitl: section, as JSON")
    parser.add_argument("--speed", type=_speed, default=1.0, help="times real time")
    parser.add_argument("--epoch-ns", type=int, default=time.monotonic_ns(), help="of the shared clock")
    parser.add_argument(
        "--lifeline", action="store_true", help="end when stdin does and the drone is at rest"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
