"""A simulator as a process: started by a `Sitl`, ready by one line, ended by the end of its stdin.

`SimulatorProcess` is the side that starts it; `add_arguments`, `simulator_clock`, `parent_watchdog` and
`announce_ready` are what the started module's ``main`` is made of. Started by hand, the same module runs
until Ctrl-C. What goes over stdin until it ends are `FaultCommands`: which faults begin and end, and where
the robot's witness writes.
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
from typing import TYPE_CHECKING, Any

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.platform import Scenario
from adatracker_deploy.sim.ground_truth import GroundTruthRecorder

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

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

    def start(self, clock: Clock, arguments: Sequence[str]) -> dict[str, Any]:
        """Start it on the run's clock; return what it announced.

        Raises:
            UsageError: it refused its arguments.
            PlatformError: it did not come up within `START_TIMEOUT_S`.
        """
        epoch_ns = clock.epoch_ns if isinstance(clock, MonotonicClock) else time.monotonic_ns()
        process = self._process = subprocess.Popen(
            [
                *(sys.executable, "-m", self._module, *arguments),
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
        """Give it an order, as `FaultCommands` reads them; a process that is gone is not told."""
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


def scenario_arguments(scenario: Scenario) -> list[str]:
    """Return the arguments by which a simulator with a camera is told which world it stands in."""
    return [
        *("--scene", scenario.scene, "--seed", str(scenario.seed)),
        *("--target-speed", repr(scenario.target_speed_m_s), "--others", str(scenario.others)),
        *("--person", scenario.person, "--width", str(scenario.width_px)),
    ]


def add_scenario_arguments(parser: argparse.ArgumentParser) -> None:
    """Add ``--scene``, ``--target-speed`` and ``--others``, of a simulator with a camera."""
    default = Scenario()
    parser.add_argument("--scene", default=default.scene, help="the world it stands in")
    parser.add_argument(
        "--target-speed", type=float, default=default.target_speed_m_s, help="of the people in it, m/s"
    )
    parser.add_argument("--others", type=int, default=default.others, help="people besides the target")
    parser.add_argument("--person", default=default.person, help="the target's .glb")
    parser.add_argument("--width", type=int, default=default.width_px, help="of its pictures, px")


def given_scenario(args: argparse.Namespace) -> Scenario:
    """Return the world that a simulator was told to stand in.

    Raises:
        UsageError: there is no such world.
    """
    return Scenario(
        scene=args.scene,
        target_speed_m_s=args.target_speed,
        seed=args.seed,
        others=args.others,
        person=args.person,
        width_px=args.width,
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what every simulator takes: ``--seed``, ``--speed``, ``--epoch-ns`` and ``--lifeline``."""
    parser.add_argument("--seed", type=int, default=0, help="of all that is random")
    parser.add_argument("--speed", type=_speed, default=1.0, help="times real time")
    parser.add_argument("--epoch-ns", type=int, default=time.monotonic_ns(), help="of the shared clock")
    parser.add_argument(
        "--lifeline", action="store_true", help="end when stdin does and the robot is at rest"
    )


def simulator_clock(args: argparse.Namespace) -> MonotonicClock:
    """Return the clock that the simulator shares with whoever started it."""
    return MonotonicClock(args.speed, args.epoch_ns)


class FaultCommands:
    """What whoever started a simulator has ordered it to suffer, and to write down."""

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
