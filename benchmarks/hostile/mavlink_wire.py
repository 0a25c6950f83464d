"""MAVLink: what comes to the adapter from the autopilot's address, from others, and without the key."""

from __future__ import annotations

import contextlib
import math
import random
import socket
import struct
import tempfile
import threading
from dataclasses import replace

from flood import Result, lives, pour, until

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.platform import Scenario
from adatracker_deploy.registry import load_platform, load_profile


class Relay(threading.Thread):
    """Stands between the simulated autopilot and the adapter, which takes it for the autopilot."""

    def __init__(self, far_port: int, port: int) -> None:
        super().__init__(daemon=True)
        self.far, self.near = _udp(far_port), _udp()
        self.near.connect(("127.0.0.1", port))
        self.autopilot = None
        self.orders = 0
        """Set-points and commands to move that came from the adapter."""
        self.place = (0.0, 0.0, 0.0)
        """The autopilot's own report, m."""
        self._ended = False

    def run(self) -> None:
        import select

        from adatracker_drone.protocol.packets import split

        while not self._ended:
            for ready in select.select([self.far, self.near], [], [], 0.1)[0]:
                with contextlib.suppress(OSError):
                    data, sender = ready.recvfrom(2048)
                    if ready is self.near:
                        self.orders += sum(map(_orders, split(data)))
                        self.far.sendto(data, self.autopilot)
                        continue
                    self.autopilot = sender
                    for packet in split(data):
                        if packet.message == 32:  # LOCAL_POSITION_NED
                            self.place = struct.unpack_from("<3f", packet.data[10:-2].ljust(28, b"\0"), 4)
                    self.near.send(data)

    def close(self) -> None:
        self._ended = True
        self.join()
        self.far.close()
        self.near.close()


def _orders(packet) -> bool:
    harmless = (511, 512)  # SET_MESSAGE_INTERVAL, REQUEST_MESSAGE
    (command,) = struct.unpack_from("<H", packet.data[10:].ljust(40, b"\0"), 28)
    return packet.message == 84 or (packet.message == 76 and command not in harmless)


def _udp(port: int = 0) -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(("127.0.0.1", port))
    made.setblocking(False)
    return made


@contextlib.contextmanager
def drone(signing_key: str = ""):
    """A connected adapter, its link's guard and the relay before it."""
    platform_class, clock = load_platform("drone"), MonotonicClock()
    profile = load_profile("px4_quad", platform_class)
    with _udp() as probe:
        port = probe.getsockname()[1]
    reached = _reached(profile, port, signing_key)  # as on the air: who it is, is not known beforehand
    with platform_class.sitl(reached) as sitl:
        far_port = int(sitl.start(clock, Scenario(seed=1)).connection.url.rpartition(":")[2])
        with contextlib.closing(Relay(far_port, port)) as relay:
            relay.start()
            with platform_class(reached, clock) as platform:
                platform.connect()
                platform.preflight()
                yield platform, platform._flight.vehicle._link.guard, relay, port


def _reached(profile, port: int, signing_key: str):
    connection = replace(profile.connection, url=f"udpin://127.0.0.1:{port}", signing_key=signing_key)
    return replace(profile, connection=connection)


def flood_drone(count: int, *, signed: bool = False, strangers: bool = False) -> Result:
    from adatracker_drone.protocol.packets import HEARD
    from adatracker_drone.sim.fuzz import datagrams

    with contextlib.ExitStack() as stack:
        key = stack.enter_context(tempfile.NamedTemporaryFile()) if signed else None
        if key is not None:
            key.write(random.Random(1).randbytes(32))
            key.flush()
        platform, guard, relay, port = stack.enter_context(drone(key.name if key else ""))
        start, orders = relay.place, relay.orders
        lost = -guard.judged
        out = relay.near
        if strangers:
            out = stack.enter_context(_udp())
            out.connect(("127.0.0.1", port))

        def keeps_up(sent: int) -> None:
            nonlocal lost
            if strangers:  # theirs go to a queue that is emptied slowly, whose overflow is lost
                return
            while guard.judged + lost < sent:
                if not until(lambda before=guard.judged: guard.judged > before, 0.2):
                    lost += sent - guard.judged - lost

        def send(datagram: bytes) -> None:
            with contextlib.suppress(BlockingIOError):
                out.send(datagram)

        seconds, grown_kb = pour(datagrams(HEARD, random.Random(2)), count, send, keeps_up)
        faults = []
        if relay.orders > orders:
            faults.append(f"{relay.orders - orders} orders were sent")
        if math.dist(relay.place, start) > 1.0:
            faults.append(f"it moved by {math.dist(relay.place, start):.1f} m")
        ignored = ", ".join(
            f"{number:,} {why.name.lower()}" for why, number in guard.ignored.items() if number
        )
        notices = len(platform.notices())
        return Result(seconds, grown_kb, f"{ignored}; {notices} notices", (*faults, *lives(platform)))


def flood_drone_from_strangers(count: int) -> Result:
    return flood_drone(count, strangers=True)


def flood_signed_drone(count: int) -> Result:
    return flood_drone(count, signed=True)
