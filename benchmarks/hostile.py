"""A million hostile packets on each inbound wire: nothing crashes, nothing moves, nothing grows.

Each wire is flooded in a process of its own, with its adapter connected to the simulated robot and not
engaged. Memory is that of the side under attack, counted once the first thousand packets have filled what is
filled once (Zenoh alone keeps 20 MB of receive buffers for a session that was sent fragments). Afterwards the
robot must be heard again, engage and disengage, as if nothing had been.

python benchmarks/hostile.py [--packets 1000000] [--wire mavlink ...]
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import math
import multiprocessing
import random
import socket
import struct
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

from adatracker_deploy.errors import PlatformError
from adatracker_deploy.platform import Platform, Scenario, load_platform
from adatracker_deploy.profile import load_profile
from adatracker_deploy.runtime.clock import MonotonicClock

WARM_UP = 1000
LARGEST_GROWTH_KB = 20_000
BATCH = 200
"""Packets between two looks at whether the other side keeps up."""
PATIENCE_S = 20.0


@dataclass(frozen=True)
class Result:
    seconds: float
    grown_kb: int
    ignored: str
    """What the side under attack says of it."""
    faults: tuple[str, ...]
    """What should not have happened."""


def main() -> int:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--packets", type=int, default=1_000_000)
    arguments.add_argument("--wire", nargs="*", choices=WIRES, default=list(WIRES))
    asked = arguments.parse_args()
    print("| wire | packets | s | more memory, MB | ignored | verdict |\n|---|---|---|---|---|---|")
    sound = True
    for name in asked.wire:
        what, flood = WIRES[name]
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as alone:
            try:
                result = alone.submit(flood, asked.packets).result()
            except Exception as error:  # whatever it is, the other wires are flooded all the same
                result = Result(0.0, 0, "", (f"{type(error).__name__}: {error}",))
        faults = [*result.faults]
        if result.grown_kb > LARGEST_GROWTH_KB:
            faults.append(f"grew by more than {LARGEST_GROWTH_KB / 1000:g} MB")
        sound = sound and not faults
        print(
            f"| {what} | {asked.packets:,} | {result.seconds:.0f} | {result.grown_kb / 1000:.1f} "
            f"| {result.ignored} | {'; '.join(faults) or 'sound'} |",
            flush=True,
        )
    return 0 if sound else 1


def memory_kb(pid: int | str = "self") -> int:
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS"))


def until(condition: Callable[[], object], patience_s: float = PATIENCE_S) -> bool:
    """Wait for a condition; return whether it came."""
    pause, end_s = threading.Event(), time.monotonic() + patience_s
    while not condition():
        if time.monotonic() > end_s:
            return False
        pause.wait(0.002)
    return True


def pour(
    packets: Iterator, count: int, send: Callable, keeps_up: Callable[[int], object], pid: int | str = "self"
) -> tuple[float, int]:
    """Send `count` packets, and before them those of the warm-up; return seconds and kB grown."""
    sent = 0

    def some(wanted: int) -> None:
        nonlocal sent
        for packet in itertools.islice(packets, wanted):
            send(packet)
            sent += 1
            if sent % BATCH == 0:
                keeps_up(sent)

    some(min(WARM_UP, count))
    before_kb, begun_s = memory_kb(pid), time.monotonic()
    some(count - min(WARM_UP, count))
    return time.monotonic() - begun_s, memory_kb(pid) - before_kb


def lives(platform: Platform) -> Iterator[str]:
    """Yield what does not work any more: hearing the robot, the preflight, engaging and disengaging."""
    asked_ns = platform.clock.now_ns()
    if not until(lambda: platform.state().t_ns > asked_ns):
        yield "the robot is not heard any more"
        return
    if platform.state().engaged or platform.state().stopped:
        yield f"it engaged, or stopped: {platform.state().stopped}"

    def unfit() -> list[str]:
        return [check.message for check in platform.preflight() if check.blocking and not check.ok]

    if not until(lambda: not unfit()):
        yield f"the preflight fails: {unfit()}"
        return
    refusals: list[str] = []

    def engages() -> bool:
        """Try; a state that the flood faked stands until the robot's own next one."""
        try:
            platform.engage()
            platform.disengage()
        except PlatformError as error:
            refusals.append(str(error))
            return False
        return True

    if not until(engages):
        yield refusals[-1]


# MAVLink


class Relay(threading.Thread):
    """Stands between the simulated autopilot and the adapter, which takes it for the autopilot."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.far, self.near = _udp(), _udp()
        self.far_port = self.far.getsockname()[1]
        self.near.connect(("127.0.0.1", port))
        self.autopilot = None
        self.orders = 0
        """Set-points and commands to move that came from the adapter."""
        self.place = (0.0, 0.0, 0.0)
        """What the autopilot itself says, m."""
        self._ended = False

    def run(self) -> None:
        import select

        from adatracker_drone.packets import split

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
    with contextlib.closing(Relay(port)) as relay:
        far_profile = _reached(profile, relay.far_port, signing_key)
        relay.far.close()  # the far end looks whether the port is free
        with platform_class.sitl(far_profile) as sitl:
            sitl.start(clock, Scenario(seed=1))
            relay.far = _udp(relay.far_port)
            relay.start()
            with platform_class(_reached(profile, port, signing_key), clock) as platform:
                platform.connect()
                platform.preflight()
                yield platform, platform._vehicle._link.guard, relay, port


def _reached(profile, port: int, signing_key: str):
    connection = replace(profile.connection, url=f"udpin://127.0.0.1:{port}", signing_key=signing_key)
    return replace(profile, connection=connection)


def flood_drone(count: int, *, signed: bool = False, strangers: bool = False) -> Result:
    from adatracker_drone.hostile import datagrams
    from adatracker_drone.packets import HEARD

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


# CAN


class _Base:
    """A simulated base behind a socketcand in this process, and what is counted on its bus."""

    def __init__(self, profile, clock) -> None:
        from adatracker_wheeled.codec import Codec
        from adatracker_wheeled.far_end import FarEnd
        from adatracker_wheeled.socketcand import SocketcandServer

        self.codec = Codec(profile.connection.roles)
        self.orders = 0
        """Commands that reached the base: the adapter's, for the flood has none."""
        self.said = 0
        """Frames of its own."""
        self.far_end = FarEnd(profile.connection.roles, profile.sitl, Scenario(seed=1), clock)
        self.server = SocketcandServer(0, self._hear)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self.far_end.serve, args=(self._say, self._ended))
        self._thread.start()

    def asks(self, frame) -> bool:
        from adatracker_wheeled.protocol import Malformed

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
        self.far_end.hear(frame)

    def _say(self, frame) -> None:
        self.said += 1
        self.server.send(frame)


def flood_base(count: int) -> Result:
    """Flood one bus: the adapter and the simulated base are in one process, and both hear all of it."""
    from adatracker_wheeled.hostile import frames

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

        ear, read = platform._helm.wire.ear, 0
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
        faults = [f"{base.orders} orders were sent"] if base.orders else []
        if base.far_end.body.wheels_m != (0.0, 0.0):
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


# Zenoh


@contextlib.contextmanager
def quadruped():
    platform_class, clock = load_platform("quadruped"), MonotonicClock()
    profile = load_profile("go2", platform_class)
    with platform_class.sitl(profile) as sitl:
        reached = sitl.start(clock, Scenario(seed=1))
        with platform_class(reached, clock) as platform:
            platform.connect()
            platform.preflight()
            yield platform, sitl.pid


def flood_host(count: int) -> Result:
    """Flood all that the host listens to, its camera's topic too."""
    from adatracker_deploy.geometry import Pose
    from adatracker_deploy.perception.compressed_image import CompressedImage
    from adatracker_deploy.platform import ZERO
    from adatracker_quadruped import messages
    from adatracker_quadruped.camera_topic import with_camera
    from adatracker_quadruped.keys import Keys

    with quadruped() as (platform, _):
        profile = platform.profile
        keys = Keys(with_camera(profile))
        image = CompressedImage(1, "jpeg", memoryview(b"\xff\xd8" + bytes(500)))
        good = {
            keys.odometry: messages.encode_odometry(messages.Odometry(Pose(), ZERO, 1)),
            keys.imu: messages.encode_imu(messages.Imu((0.0,) * 3, (0.0,) * 3, (0.0, 0.0, 9.8), 1)),
            keys.battery: messages.encode_battery(0.5),
            keys.camera: messages.encode_compressed_image(image),
        }
        with _camera(profile, platform.clock) as camera:
            seconds, grown_kb, orders = _publish(profile.connection, good, count, "self")
            dropped = camera.dropped + platform._wire.watch.dropped
            faults = [f"{orders} orders were sent"] if orders else []
            seen = camera.read(platform.clock.now_ns()).seq
            if not until(lambda: camera.read(platform.clock.now_ns()).seq > seen):
                faults.append("the camera shows nothing any more")
        return Result(seconds, grown_kb, f"{dropped:,} malformed", (*faults, *lives(platform)))


@contextlib.contextmanager
def _camera(profile, clock):
    """The robot's camera, open; on a busy machine its first picture takes longer than a trial would wait."""
    from adatracker_quadruped.camera import ZenohCamera

    for attempt in range(5):
        with contextlib.closing(ZenohCamera(profile, clock)) as camera:
            try:
                camera.open()
            except PlatformError:
                if attempt == 4:
                    raise
                continue
            yield camera
            return


def flood_robot(count: int) -> Result:
    """Flood the commands of the simulated robot."""
    from adatracker_deploy.platform import ZERO
    from adatracker_quadruped.keys import Keys
    from adatracker_quadruped.messages import encode_twist

    with quadruped() as (platform, pid):
        start = platform.state().pose
        good = {Keys(platform.profile.connection).command: encode_twist(ZERO)}
        seconds, grown_kb, _ = _publish(platform.profile.connection, good, count, pid)
        place = platform.state().pose
        moved = start.distance_to(place.x, place.y) > 1e-6
        return Result(seconds, grown_kb, "not told", (*(["it walked"] if moved else []), *lives(platform)))


def _publish(connection, good: dict[str, bytes], count: int, pid: int | str) -> tuple[float, int, int]:
    """Publish payloads on all the keys in turn; return seconds, kB grown, and the commands that were seen."""
    import zenoh

    from adatracker_quadruped.hostile import payloads
    from adatracker_quadruped.keys import Keys
    from adatracker_quadruped.session import open_session

    with open_session(connection) as session:
        block = zenoh.CongestionControl.BLOCK
        publishers = {key: session.declare_publisher(key, congestion_control=block) for key in good}
        until(lambda: all(publisher.matching_status.matching for publisher in publishers.values()))
        command = Keys(connection).command
        orders = (
            session.declare_subscriber(command, zenoh.handlers.RingChannel(8))
            if command not in good
            else None
        )
        for publisher in publishers.values():
            for _ in range(500):
                publisher.put(bytes(100_000))  # fills the receive buffers for fragments
        streams = [(publishers[key], payloads(good[key], random.Random(key))) for key in good]
        mixed = ((publisher, next(stream)) for publisher, stream in itertools.cycle(streams))
        seconds, grown_kb = pour(mixed, count, lambda pair: pair[0].put(pair[1]), lambda _: None, pid)
        seen = 0
        while orders is not None and orders.try_recv() is not None:
            seen += 1
        return seconds, grown_kb, seen


WIRES = {
    "mavlink": ("MAVLink, from the autopilot's own address", flood_drone),
    "mavlink-strangers": ("MAVLink, from another address", flood_drone_from_strangers),
    "mavlink-signed": ("MAVLink signed, from the autopilot's address without the key", flood_signed_drone),
    "can": ("CAN (socketcand), host and base", flood_base),
    "zenoh-host": ("Zenoh, all that the host hears, camera too", flood_host),
    "zenoh-robot": ("Zenoh, commands of the simulated robot", flood_robot),
}


if __name__ == "__main__":
    sys.exit(main())
