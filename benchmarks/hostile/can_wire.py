"""CAN over a socketcand: host and base hear all of it."""

from __future__ import annotations

import contextlib
import random
import socket
import threading
from dataclasses import replace

from flood import BATCH, Result, lives, pour, until

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.platform import Scenario
from adatracker_deploy.registry import load_platform, load_profile


class _Base:
    """A simulated base behind a socketcand in this process, and what is counted on its bus."""

    def __init__(self, profile, clock) -> None:
        from adatracker_wheeled.protocol.codec import Codec
        from adatracker_wheeled.sim.simulator import Simulator
        from adatracker_wheeled.sim.socketcand import SocketcandServer

        self.codec = Codec(profile.connection.roles)
        self.orders = 0
        """Commands that reached the base: the adapter's, for the flood has none."""
        self.said = 0
        """Frames of its own."""
        self.simulator = Simulator(profile.connection.roles, profile.sitl, Scenario(seed=1), clock)
        self.server = SocketcandServer(0, self._hear)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self.simulator.serve, args=(self._say, self._ended))
        self._thread.start()

    def asks(self, frame) -> bool:
        from adatracker_wheeled.protocol.frames import Malformed

        try:
            return self.codec.parse_command(frame) is not None
        except Malformed:
            return False

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self.server.close()

    def _hear(self, frame) -> None:
        self.orders += self.asks(frame)
        self.simulator.hear(frame)

    def _say(self, frame) -> None:
        self.said += 1
        self.server.send(frame)


def flood_base(count: int) -> Result:
    """Flood one bus: the adapter and the simulated base are in one process, and both hear all of it."""
    from adatracker_wheeled.sim.fuzz import frames

    platform_class, clock = load_platform("wheeled"), MonotonicClock()
    profile = load_profile("scout", platform_class)
    with contextlib.ExitStack() as stack:
        base = stack.enter_context(contextlib.closing(_Base(profile, clock)))
        port = base.server.port
        reached = replace(profile.connection, interface="socketcand", channel="can0", port=port)
        platform = stack.enter_context(platform_class(replace(profile, connection=reached), clock))
        platform.connect()
        bus = stack.enter_context(socket.create_connection(("127.0.0.1", port)))
        bus.sendall(b"< open can0 >< rawmode >")
        threading.Thread(target=_drain, args=(bus,), daemon=True).start()

        def send(frame) -> None:
            data = " ".join(f"{byte:02X}" for byte in frame.data)
            bus.sendall(f"< send {frame.id:03X} {len(frame.data):X} {data} >".encode())

        ear, read = platform._authority.wire.ear, 0
        receive, before = ear.receive, base.said

        def reading(frame, now_ns: int) -> None:
            nonlocal read
            read += 1
            receive(frame, now_ns)

        ear.receive = reading

        def keeps_up(sent: int) -> None:
            """A bus is slow, but TCP would keep minutes of it for a reader that is late."""
            until(lambda: read >= sent + base.said - before - BATCH)

        known = sorted({frame.id for frame in base.codec.enable()} | _heard_ids(port))
        noise = (frame for frame in frames(known, random.Random(2)) if not base.asks(frame))
        seconds, grown_kb = pour(noise, count, send, keeps_up)
        until(lambda: platform._authority.wire.rival() is None)  # some of it had the ids of commands
        faults = [f"{base.orders} orders were sent"] if base.orders else []
        if base.simulator.body.wheels_m != (0.0, 0.0):
            faults.append("its wheels turned")
        ignored = f"{ear.malformed:,} malformed, {len(ear.strangers)} strange ids"
        return Result(seconds, grown_kb, ignored, (*faults, *lives(platform)))


def _drain(bus: socket.socket) -> None:
    """Read and forget: who does not read is thrown off the bus."""
    with contextlib.suppress(OSError):
        while bus.recv(65536):
            pass


def _heard_ids(port: int) -> set[int]:
    """Return the ids that the base itself uses."""
    with socket.create_connection(("127.0.0.1", port)) as bus:
        bus.sendall(b"< open can0 >< rawmode >")
        text = b""
        while text.count(b"< frame") < 200:
            text += bus.recv(65536)
    return {
        int(line.split()[1], 16) for line in text.split(b"< ") if line.startswith(b"frame") and b">" in line
    }
