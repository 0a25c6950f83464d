"""Flights through real processes, watched by a ground station that shares no code with the toolkit."""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml
from pymavlink import mavutil

from adatracker_deploy.registry import profile_dir

COMMAND = [sys.executable, "-m", "adatracker_deploy"]
DISARMED_LANDED = mavutil.mavlink.MAV_LANDED_STATE_ON_GROUND


@dataclass(frozen=True)
class Sample:
    """The ground station's measurements at one time of the machine's monotonic clock."""

    t_s: float
    speed_m_s: float
    altitude_m: float


class GroundStation:
    """A plain pymavlink listener on a free loopback port."""

    def __init__(self) -> None:
        self.link = mavutil.mavlink_connection("udpin:127.0.0.1:0")
        self.port = self.link.port.getsockname()[1]
        self.samples: list[Sample] = []
        self.landed = self.armed = None
        self._change = threading.Condition()
        self._ending = False
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        while not self._ending:
            message = self.link.recv_match(blocking=True, timeout=0.2)
            if message is None:
                continue
            kind = message.get_type()
            with self._change:
                if kind == "LOCAL_POSITION_NED":
                    speed = math.hypot(message.vx, message.vy)
                    self.samples.append(Sample(time.monotonic(), speed, -message.z))
                elif kind == "EXTENDED_SYS_STATE":
                    self.landed = message.landed_state == DISARMED_LANDED
                elif kind == "HEARTBEAT" and message.get_srcComponent() == 1:
                    self.armed = bool(message.base_mode & mavutil.mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
                self._change.notify_all()

    def wait(self, condition, timeout_s: float, what: str) -> float:
        """Wait until `condition(self)` holds; return the machine's monotonic time."""
        with self._change:
            if not self._change.wait_for(lambda: condition(self), timeout_s):
                last = self.samples[-1] if self.samples else None
                pytest.fail(f"not within {timeout_s} s: {what}; last seen {last}, armed {self.armed}")
        return time.monotonic()

    def wait_until_flying(self, speed_m_s: float) -> None:
        self.wait(lambda s: s.samples and s.samples[-1].speed_m_s > speed_m_s, 60, f"flies {speed_m_s} m/s")

    def wait_until_halted(self, since_s: float, speed_m_s: float = 0.3) -> float:
        """Return the seconds from `since_s` until the speed fell below `speed_m_s`."""
        self.wait(lambda s: s.samples[-1].speed_m_s < speed_m_s, 20, "the drone halts")
        return self.samples[-1].t_s - since_s

    def wait_until_down(self, since_s: float) -> float:
        """Return the seconds from `since_s` until landed and disarmed."""
        return self.wait(lambda s: s.landed and s.armed is False, 40, "lands and disarms") - since_s

    def close(self) -> None:
        self._ending = True
        self._thread.join()
        self.link.close()


class Flight:
    """The command in a process group of its own."""

    def __init__(self, arguments: list[str], folder: Path) -> None:
        self.process = subprocess.Popen(
            arguments, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )

    @property
    def pid(self) -> int:
        return self.process.pid

    def children(self) -> dict[int, str]:
        """Return the living direct children as {pid: name}."""
        listing = Path(f"/proc/{self.pid}/task/{self.pid}/children").read_text()
        return {int(pid): Path(f"/proc/{pid}/comm").read_text().strip() for pid in listing.split()}

    def link_pid(self) -> int:
        (pid,) = [pid for pid, name in self.children().items() if name == "adatracker-link"]
        return pid

    def end(self, timeout_s: float = 90) -> tuple[int, dict | None, str]:
        """Wait for the end; return exit status, the JSON summary if there is one, and stderr."""
        out, err = self.process.communicate(timeout=timeout_s)
        lines = out.strip().splitlines()
        return self.process.returncode, json.loads(lines[-1]) if lines else None, err


def follow_to_the_horizon(platform: str, folder: Path) -> dict:
    """Have a ground robot follow for 200 steps of a rehearsal; return the summary of a good run."""
    run = Flight(
        [
            *(*COMMAND, "--platform", platform, "--sitl", "--segmenter", "truth"),
            *("--seed", "1", "--steps", "200", "--json"),
        ],
        folder,
    )
    status, summary, err = run.end(timeout_s=120)
    assert status == 0, err
    assert (summary["outcome"], summary["el"]) == ("completed", 200)
    assert summary["mr"] >= 0.80
    assert summary["ar"] > 130  # the truth came beside the pictures
    return summary


def gone(pid: int) -> bool:
    """Tell whether a process has ended (a zombie has)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    except FileNotFoundError:
        return True


@pytest.fixture
def station():
    station = GroundStation()
    yield station
    station.close()


@pytest.fixture
def profile(tmp_path, station):
    """The shipped profile on a free port, with the ground station listening."""
    document = yaml.safe_load((profile_dir() / "px4_quad.yaml").read_text())
    document["connection"]["url"] = "udpin://127.0.0.1:0"
    document["sitl"]["gcs"] = f"udpout:127.0.0.1:{station.port}"
    path = tmp_path / "px4_quad_test.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


@contextlib.contextmanager
def started(folder, *common: str):
    """Give a function that starts the command with `common` and more; kill what is left of it at the end."""
    flights: list[Flight] = []
    families: list[int] = []

    def start(*arguments: str, command: list[str] = COMMAND) -> Flight:
        flight = Flight([*command, *common, *arguments], folder)
        flights.append(flight)
        return flight

    try:
        yield start
    finally:
        for flight in flights:
            with contextlib.suppress(FileNotFoundError, ProcessLookupError):
                families.extend(flight.children())
            flight.process.kill()
            flight.process.wait()
            flight.process.stdout.close()
            flight.process.stderr.close()
        for pid in families:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)


@pytest.fixture
def fly(tmp_path, profile):
    """Give a function that starts the drone's rehearsal, by default with the truth as its segmenter."""
    common = "--platform", "drone", "--sitl", "--profile", str(profile), "--segmenter", "truth"
    with started(tmp_path, *common) as start:
        yield start
