"""The wheeled base and the quadruped as a stranger meets them: a simulator run by hand, a cable, a watcher.

The watchers share no code with the robots' packages: one reads socketcand's text, the other CDR by hand.
"""

from __future__ import annotations

import abc
import contextlib
import itertools
import json
import math
import socket
import struct
import threading
import time
from dataclasses import dataclass

import pytest
import yaml
import zenoh

from adatracker_deploy.registry import profile_dir
from tests.by_hand import simulator_by_hand
from tests.quadruped.cdr import LAYOUTS, decode

from .cable import Cable


@dataclass(frozen=True)
class Sample:
    """A measured speed at one moment of the machine's monotonic clock."""

    t_s: float
    speed_m_s: float


class Watcher:
    """Keeps every speed that the robot itself measures."""

    def __init__(self) -> None:
        self.samples: list[Sample] = []
        self._news = threading.Condition()

    def see(self, speed_m_s: float) -> None:
        with self._news:
            self.samples.append(Sample(time.monotonic(), abs(speed_m_s)))
            self._news.notify_all()

    def wait_for(self, condition, timeout_s: float, what: str) -> Sample:
        """Return the first new sample that meets `condition`."""
        end_s = time.monotonic() + timeout_s
        with self._news:
            at = len(self.samples)
            while True:
                for sample in self.samples[at:]:
                    if condition(sample):
                        return sample
                at = len(self.samples)
                if not self._news.wait(end_s - time.monotonic()):
                    pytest.fail(f"not within {timeout_s} s: {what}; last seen {self.samples[-1:]}")

    def wait_until_cruising(self, speed_m_s: float) -> None:
        """Wait for a second at more than `speed_m_s`."""
        began = self.wait_for(lambda sample: sample.speed_m_s > speed_m_s, 60, f"drives {speed_m_s} m/s")
        since_s = began.t_s

        def cruising(sample: Sample) -> bool:
            nonlocal since_s
            if sample.speed_m_s < speed_m_s:
                since_s = sample.t_s
            return sample.t_s - since_s > 1.0

        self.wait_for(cruising, 60, f"keeps {speed_m_s} m/s for a second")

    def halted_after(self, onset_s: float, still_m_s: float = 0.05) -> float:
        """Return the seconds from `onset_s` until the robot stood, having seen that it stays so."""
        halt = self.wait_for(lambda sample: sample.speed_m_s < still_m_s, 10, "halts")
        self.wait_for(lambda sample: sample.t_s > halt.t_s + 1.0, 10, "is heard after the halt")
        moved = [sample for sample in self.samples if sample.t_s > halt.t_s and sample.speed_m_s > still_m_s]
        assert not moved, f"moved again after the halt: {moved[:3]}"
        return halt.t_s - onset_s

    def gone_m(self, since_s: float) -> float:
        """Return how far it went from `since_s` on, by its own measured speed."""
        later = [sample for sample in self.samples if sample.t_s >= since_s]
        return math.fsum(a.speed_m_s * (b.t_s - a.t_s) for a, b in itertools.pairwise(later))


class GroundRobot(abc.ABC):
    """A simulator by hand, the cable to it, the profile that goes through the cable, and a watcher."""

    module: str
    shipped: str
    any_port: tuple[str, ...] = ()

    def __init__(self, folder, *arguments: str) -> None:
        self.watcher = Watcher()
        self._simulated = contextlib.ExitStack()
        there = self._simulated.enter_context(
            simulator_by_hand(self.module, "--profile", self.shipped, *self.any_port, *arguments)
        )
        self.simulator, self.ready = there.process, there.ready
        self.cable = Cable(("127.0.0.1", self.port()))
        document = yaml.safe_load((profile_dir() / f"{self.shipped}.yaml").read_text())
        document["limits"]["forward_m_s"] = 0.5  # the speed that the published stop times were taken at
        self.connect(document)
        self.profile = folder / f"{self.shipped}_cabled.yaml"
        self.profile.write_text(yaml.safe_dump(document))
        self.watch()

    @abc.abstractmethod
    def port(self) -> int: ...

    @abc.abstractmethod
    def connect(self, document) -> None: ...

    @abc.abstractmethod
    def watch(self) -> None: ...

    @abc.abstractmethod
    def unwatch(self) -> None: ...

    def close(self) -> None:
        self.unwatch()
        self.cable.close()
        self._simulated.close()


class Wheeled(GroundRobot):
    name = "wheeled"
    module = "adatracker_wheeled.sim.sitl"
    shipped = "scout"

    def port(self) -> int:
        return self.ready["port"]

    def connect(self, document) -> None:
        document["connection"].update(interface="socketcand", host="127.0.0.1", port=self.cable.port)
        document["camera"]["uri"] = self.ready["camera"]

    def watch(self) -> None:
        self._socket = socket.create_connection(("127.0.0.1", self.port()))
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        self._socket.sendall(b"< open can0 >< rawmode >")
        rest = ""
        while data := self._receive():
            *lines, rest = (rest + data.decode()).split(">")
            for words in (line.split() for line in lines):
                if words[1:3] == ["frame", "221"]:
                    (millimetres,) = struct.unpack_from(">h", bytes.fromhex("".join(words[4:])))
                    self.watcher.see(millimetres / 1000)

    def _receive(self) -> bytes:
        try:
            return self._socket.recv(65536)
        except OSError:
            return b""

    def unwatch(self) -> None:
        self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._socket.close()


class Quadruped(GroundRobot):
    name = "quadruped"
    module = "adatracker_quadruped.sim.sitl"
    shipped = "go2"
    any_port = ("--listen", "tcp/127.0.0.1:0")

    def port(self) -> int:
        return int(self.ready["endpoint"].rsplit(":", 1)[1])

    def connect(self, document) -> None:
        document["connection"]["endpoint"] = f"tcp/127.0.0.1:{self.cable.port}"

    def watch(self) -> None:
        config = zenoh.Config()
        for key, value in {
            "mode": "client",
            "connect/endpoints": [f"tcp/127.0.0.1:{self.port()}"],
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
        }.items():
            config.insert_json5(key, json.dumps(value))
        self._session = zenoh.open(config)
        self._odometry = self._session.declare_subscriber("odom", zenoh.handlers.FifoChannel(64))
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        layout = LAYOUTS["Odometry"]
        for sample in self._odometry:
            values = decode(layout, sample.payload.to_bytes())
            vx, vy = values[-42:-40]
            self.watcher.see(math.hypot(vx, vy))

    def unwatch(self) -> None:
        self._session.close()
        self._thread.join(5.0)


ROBOTS = {robot.name: robot for robot in (Wheeled, Quadruped)}
