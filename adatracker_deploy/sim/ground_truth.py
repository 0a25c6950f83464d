"""Ground-truth recorder: commands that reached the simulated robot, and its true motion, in a crash-proof
file.

One event per line: machine time (`time.monotonic_ns`, the same in every process), a word, its values::

    81516371244106 command 0.812 0.0 0.0 -0.113     velocity that reached the robot: vx vy vz yaw_rate
    81516376032871 speed 0.790                      its true speed over the ground, m/s
    81516376032903 flight 1.42 0.88                 one that flies: how fast it climbs, m/s, and its height, m
    81516376032911 mode OFFBOARD armed              one that flies: whenever it changes
    81516376100000 process robot 4711               who is who; written by each part's own process
    81516380217788 suffers camera_freeze            by the robot, when it was ordered to
    81516376200000 phase following                  written by the injector, with the following three
    81516380217755 begin camera_freeze              as soon as it has
    81518380411902 end camera_freeze
    81518380500000 stood 0.104                      the tracker's interpreter has stood still for so long, s
    81519990332047 off                              the simulator has ended, its robot at rest

Each line is one write at the file's end, so that several processes share the file.
"""

from __future__ import annotations

import contextlib
import math
import os
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from adatracker_deploy.core.messages import Twist

FILE_NAME = "witness.txt"
STILL = 1e-3
"""Smaller values, m/s and rad/s, are not a motion command; a CAN frame's smallest is 0.001."""


class GroundTruthRecorder:
    """Appends events to a file; without a file it records nothing.

    Args:
        path: the file to create; None for no record.

    Raises:
        OSError: it cannot be written.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._fd = None if path is None else os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
        self._mode: tuple[str, bool] | None = None

    def command(self, twist: Twist) -> None:
        """Record a velocity command that has reached the robot."""
        self._write(f"command {twist.vx:.4g} {twist.vy:.4g} {twist.vz:.4g} {twist.yaw_rate:.4g}")

    def speed(self, speed_m_s: float) -> None:
        """Record the robot's true ground speed."""
        self._write(f"speed {speed_m_s:.4g}")

    def flight(self, up_m_s: float, height_m: float) -> None:
        """Record the robot's true climb rate, and its height above its starting point."""
        self._write(f"flight {up_m_s:.4g} {height_m:.4g}")

    def mode(self, name: str, *, armed: bool) -> None:
        """Record the flight mode and whether the robot is armed; only changes are written."""
        if self._mode != (name, armed):
            self._mode = (name, armed)
            self._write(f"mode {name} {'armed' if armed else 'disarmed'}")

    def record_fault(self, name: str) -> None:
        """Record that a fault now affects the robot."""
        self._write(f"suffers {name}")

    def process(self, role: str, pid: int = 0) -> None:
        """Record the process id of the robot, the tracker or the link; 0 for the calling process."""
        self._write(f"process {role} {pid or os.getpid()}")

    def phase(self, name: str) -> None:
        """Record that a trial has entered a phase."""
        self._write(f"phase {name}")

    def stood(self, seconds: float) -> None:
        """Record that the tracker's interpreter was stalled until now."""
        self._write(f"stood {seconds:.4g}")

    def fault(self, name: str, *, begins: bool) -> None:
        """Record that a fault has been injected, or is over."""
        self._write(f"{'begin' if begins else 'end'} {name}")

    def off(self) -> None:
        """Record that the robot is at rest and its simulator exits."""
        self._write("off")

    def close(self) -> None:
        """Close the file; may be called twice."""
        fd, self._fd = self._fd, None
        if fd is not None:
            os.close(fd)

    def _write(self, words: str) -> None:
        if self._fd is not None:
            with contextlib.suppress(OSError):  # a full disk must not stop the simulation
                os.write(self._fd, f"{time.monotonic_ns()} {words}\n".encode())


@dataclass(frozen=True, slots=True)
class Told:
    """A velocity command that reached the robot."""

    t_ns: int
    vx: float
    vy: float
    vz: float
    yaw_rate: float

    @property
    def moves(self) -> bool:
        """Whether it commands horizontal motion or turning; a drone also climbs to hold its height."""
        return max(abs(self.vx), abs(self.vy), abs(self.yaw_rate)) >= STILL or not math.isfinite(
            self.vx + self.vy + self.vz + self.yaw_rate
        )


@dataclass(frozen=True, slots=True)
class Flying:
    """One sample of a flight."""

    t_ns: int
    up_m_s: float
    height_m: float


@dataclass(frozen=True, slots=True)
class Account:
    """A parsed ground-truth record, in order of time; times are the machine's, ns."""

    commands: tuple[Told, ...] = ()
    speeds: tuple[tuple[int, float], ...] = ()
    """(time, m/s)."""
    faults: tuple[tuple[int, str, bool], ...] = ()
    """(time, name, whether it begins)."""
    off: bool = False
    """The simulator ended in order."""
    flight: tuple[Flying, ...] = ()
    modes: tuple[tuple[int, str, bool], ...] = ()
    """(time, flight mode, whether armed)."""
    phases: tuple[tuple[int, str], ...] = ()
    """(time, phase that begins); several trials may follow each other."""
    stood: tuple[tuple[int, float], ...] = ()
    """(end of a stall of the tracker's interpreter, its duration in s)."""
    suffered: tuple[tuple[int, str], ...] = ()
    """(time, fault that affects the robot from then on)."""
    processes: tuple[tuple[str, int], ...] = ()
    """(role, process id)."""

    def onset_ns(self, name: str) -> int | None:
        """Return when a fault first began; None if it never did."""
        return next((t_ns for t_ns, found, begins in self.faults if begins and found == name), None)

    def over_ns(self, name: str) -> int | None:
        """Return when a fault first ended; None if it never did."""
        return next((t_ns for t_ns, found, begins in self.faults if not begins and found == name), None)

    def phase_at(self, t_ns: int) -> str:
        """Return the trial's phase at a time; empty before the first."""
        return next((phase for began_ns, phase in reversed(self.phases) if began_ns <= t_ns), "")

    def speed_at(self, t_ns: int) -> float:
        """Return the robot's last recorded speed, m/s; 0 before the first."""
        return next((speed for seen_ns, speed in reversed(self.speeds) if seen_ns <= t_ns), 0.0)

    def process(self, role: str) -> int | None:
        """Return the process id of a role; None if not recorded."""
        return next((pid for found, pid in self.processes if found == role), None)


def read_witness(text: str) -> Account:
    """Read a ground-truth file; an incomplete last line is ignored."""
    commands: list[Told] = []
    speeds: list[tuple[int, float]] = []
    faults: list[tuple[int, str, bool]] = []
    flight: list[Flying] = []
    modes: list[tuple[int, str, bool]] = []
    phases: list[tuple[int, str]] = []
    stood: list[tuple[int, float]] = []
    suffered: list[tuple[int, str]] = []
    processes: list[tuple[str, int]] = []
    off = False
    for line in text.splitlines():
        with contextlib.suppress(ValueError, IndexError, TypeError):
            time_text, what, *values = line.split()
            t_ns = int(time_text)
            match what:
                case "command":
                    commands.append(Told(t_ns, *map(float, values)))
                case "speed":
                    speeds.append((t_ns, float(values[0])))
                case "flight":
                    flight.append(Flying(t_ns, float(values[0]), float(values[1])))
                case "mode":
                    modes.append((t_ns, values[0], values[1] == "armed"))
                case "phase":
                    phases.append((t_ns, values[0]))
                case "stood":
                    stood.append((t_ns, float(values[0])))
                case "suffers":
                    suffered.append((t_ns, values[0]))
                case "process":
                    processes.append((values[0], int(values[1])))
                case "begin" | "end":
                    faults.append((t_ns, values[0], what == "begin"))
                case "off":
                    off = True
    return Account(
        commands=tuple(sorted(commands, key=lambda told: told.t_ns)),
        speeds=tuple(sorted(speeds)),
        faults=tuple(sorted(faults)),
        off=off,
        flight=tuple(sorted(flight, key=lambda moment: moment.t_ns)),
        modes=tuple(sorted(modes)),
        phases=tuple(sorted(phases)),
        stood=tuple(sorted(stood)),
        suffered=tuple(sorted(suffered)),
        processes=tuple(processes),
    )
