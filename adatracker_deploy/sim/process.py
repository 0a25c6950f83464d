"""A simulator as a process: started by a `Sitl`, ready by one line, ended by the end of its stdin.

`ProcessSitl` and its `SimulatorProcess` are the side that starts it; `add_arguments`, `given_scenario`,
`simulator_clock`, `parent_watchdog` and `announce_ready` are what the started module's ``main`` is made of.
Started by hand, the same module runs until Ctrl-C. What goes over stdin until it ends are `FaultCommands`:
which faults begin and end, and where the robot's witness writes.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import msgspec

from adatracker_deploy.config.schema import parse
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.platform import Scenario, Sitl
from adatracker_deploy.sim.ground_truth import GroundTruthRecorder

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.clock import Clock

ASKED_WRONG = 2
"""Exit status of settings that cannot be; the process prints the reason as its only line."""
START_TIMEOUT_S = 20.0


class SimulatorProcess:
    """One simulator's process.

    Args:
        module: what ``python -m`` runs.
        robot: how errors name it, for example ``simulated drone``.
        stop_timeout_s: how long `close` lets the robot come to rest before it kills the process.
    """

    def __init__(self, module: str, robot: str, stop_timeout_s: float = 10.0) -> None:
        self._module = module
        self._robot = robot
        self._stop_timeout_s = stop_timeout_s
        self._process: subprocess.Popen[str] | None = None

    @property
    def pid(self) -> int | None:
        """The process's id; None before `start` and after `close`."""
        return self._process.pid if self._process else None

    def start(self, clock: Clock, scenario: Scenario, arguments: Sequence[str] = ()) -> dict[str, Any]:
        """Start it on the run's clock and in the rehearsal's world; return what it announced.

        Raises:
            UsageError: it refused its arguments.
            PlatformError: it did not come up within `START_TIMEOUT_S`.
        """
        epoch_ns = clock.epoch_ns if isinstance(clock, MonotonicClock) else time.monotonic_ns()
        process = self._process = subprocess.Popen(
            [
                *(sys.executable, "-m", self._module, *arguments),
                *("--scenario", msgspec.json.encode(scenario).decode()),
                *("--lifeline", "--speed", repr(clock.speed), "--epoch-ns", str(epoch_ns)),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # a Ctrl-C in the terminal must not take the robot from its wire
        )
        assert process.stdout is not None
        timer = threading.Timer(START_TIMEOUT_S, process.kill)
        timer.start()
        try:
            line = process.stdout.readline()
        finally:
            timer.cancel()
        if not line.startswith('{"ready"'):
            self.close()
            if process.returncode == ASKED_WRONG:
                raise UsageError(line.strip() or f"the {self._robot} refused to start: see its error above")
            raise PlatformError(f"the {self._robot} did not start: {line.strip() or 'see its error above'}")
        ready: dict[str, Any] = json.loads(line)["ready"]
        return ready

    def order(self, line: str) -> None:
        """Send it a command for `FaultCommands`; nothing happens if the process is gone."""
        if self._process is not None and self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.write(f"{line}\n")
                self._process.stdin.flush()

    def close(self) -> None:
        """End the lifeline and wait until the robot has come to rest; may be called twice."""
        process, self._process = self._process, None
        if process is None or process.stdin is None or process.stdout is None:
            return
        with contextlib.suppress(OSError):  # an order that could not be given is still in its buffer
            process.stdin.close()
        try:
            process.wait(self._stop_timeout_s)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stdout.close()


class ProcessSitl(Sitl):
    """A `Sitl` of one process; a robot's own says what it is and how it starts.

    Args:
        profile: of the robot that is simulated.
    """

    module: ClassVar[str]
    """Run by ``python -m``; this and the next two as for `SimulatorProcess`."""
    robot: ClassVar[str]
    stop_timeout_s: ClassVar[float] = 10.0

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        self._process = SimulatorProcess(self.module, self.robot, self.stop_timeout_s)

    @property
    def pid(self) -> int | None:
        """The simulator's process id; None while there is none."""
        return self._process.pid

    def close(self) -> None:
        """Tell the process to end and wait until its robot has come to rest; may be called twice."""
        self._process.close()

    def order(self, line: str) -> None:
        """Send a command to the simulator."""
        self._process.order(line)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what every simulator takes: ``--scenario``, ``--speed``, ``--epoch-ns`` and ``--lifeline``."""
    parser.add_argument(
        "--scenario", default="{}", help='seed and world as JSON: {"seed": 3, "scene": "urban_city"}'
    )
    parser.add_argument("--speed", type=_speed, default=1.0, help="times real time")
    parser.add_argument("--epoch-ns", type=int, default=time.monotonic_ns(), help="of the shared clock")
    parser.add_argument(
        "--lifeline", action="store_true", help="end when stdin does and the robot is at rest"
    )


def given_scenario(args: argparse.Namespace) -> Scenario:
    """Return the seed and the world that the arguments name.

    Raises:
        UsageError: they name no `Scenario`.
    """
    try:
        return parse(Scenario, json.loads(args.scenario), where="--scenario")
    except json.JSONDecodeError as error:
        raise UsageError(f"--scenario: {error}") from error


def simulator_clock(args: argparse.Namespace) -> MonotonicClock:
    """Return the clock that the simulator shares with its parent process."""
    return MonotonicClock(args.speed, args.epoch_ns)


class FaultCommands:
    """Fault and logging commands from the process that started the simulator."""

    def __init__(self) -> None:
        self.faults: frozenset[str] = frozenset()
        """The names of the faults that are on."""
        self.witness = GroundTruthRecorder()
        self._listeners: list[Callable[[frozenset[str]], None]] = []

    def listen(self, listener: Callable[[frozenset[str]], None]) -> None:
        """Have `listener` called, in the orders' thread, with the faults that are on whenever they change."""
        self._listeners.append(listener)

    def handle(self, line: str) -> None:
        """Take one order: ``begin FAULT``, ``end FAULT`` or ``witness FILE``; others mean nothing."""
        order, _, what = line.strip().partition(" ")
        match order:
            case "begin":
                self.faults |= {what}
                self.witness.record_fault(what)
            case "end":
                self.faults -= {what}
            case "witness":
                with contextlib.suppress(OSError):  # it is not the robot's business
                    self.witness = GroundTruthRecorder(Path(what))
                    self.witness.process("robot")
                return
            case _:
                return
        for listener in self._listeners:
            listener(self.faults)


def parent_watchdog(args: argparse.Namespace, orders: FaultCommands | None = None) -> threading.Event:
    """Return an event that is set when the simulator should come to rest and end; `orders` hear of stdin."""
    ended = threading.Event()

    def outlive_stdin() -> None:
        for line in sys.stdin:
            if orders is not None:
                orders.handle(line)
        ended.set()

    if args.lifeline:
        threading.Thread(target=outlive_stdin, daemon=True).start()
    return ended


def announce_ready(**what: Any) -> None:
    """Print the one line that says that the simulator is up, and where it is reached."""
    print(json.dumps({"ready": what}), flush=True)


def refuse(error: Exception) -> int:
    """Print why the settings cannot be; return the exit status that says so."""
    print(" ".join(str(error).split()), flush=True)
    return ASKED_WRONG


def _speed(text: str) -> float:
    if not 0.05 <= float(text) <= 50:
        raise argparse.ArgumentTypeError(f"{text} is not between 0.05 and 50")
    return float(text)
