"""The simulator's main loop: a trotting body in a world, and its ROS 2 topics over Zenoh."""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import zenoh

from adatracker_deploy.config.schema import Range
from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.faults import CAMERA_GONE, LINK_DROP
from adatracker_deploy.core.messages import ZERO
from adatracker_deploy.perception.compressed_image import CompressedImage
from adatracker_deploy.runtime.pacer import Pacer
from adatracker_deploy.sim.process import FaultCommands
from adatracker_deploy.sim.rehearsal import Rehearsal
from adatracker_quadruped.protocol.command_decoder import STALE_S, CommandDecoder
from adatracker_quadruped.protocol.connection import Connection
from adatracker_quadruped.protocol.keys import Keys
from adatracker_quadruped.protocol.messages import encode_compressed_image
from adatracker_quadruped.protocol.publisher import Publisher
from adatracker_quadruped.protocol.rehearsal_keys import ORDERED, Fault, SitlKeys, encode_stamped_truth
from adatracker_quadruped.protocol.session import zenoh_config
from adatracker_quadruped.sim.dynamics import QuadrupedBody
from adatracker_quadruped.sim.sensors import Senses
from adatracker_quadruped.sim.settings import SitlSettings

if TYPE_CHECKING:
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.messages import Shot
    from adatracker_deploy.platform import Scenario

LOOK_HZ = 100.0
"""Polling rate of the channels in machine time; also bounds the delay of a stop."""
LONGEST_LAG_S = 0.25
"""A process that was kept from running for longer skips the time instead of rushing through it."""
DEAF_S = 0.2
"""After a gap in which commands may have piled up, machine time for which all of them are dropped."""
LINGER_S = 5.0
"""Machine time that the robot has to stand after its parent process has ended."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Robot:
    """The simulated robot's settings."""

    connection: Connection
    """Its endpoint and dialect; with a camera topic."""
    sitl: SitlSettings
    camera_hz: Annotated[float, Range(1, 240)]


class Simulator:
    """One robot, standing, that anybody who reaches its endpoint can walk.

    Args:
        robot: what it is.
        scenario: the world that it stands in.
        clock: the run's.
        orders: fault commands, and where they are reported.

    Raises:
        PlatformError: it cannot listen at its endpoint.
        UsageError: no such scene.
    """

    def __init__(
        self, robot: Robot, scenario: Scenario, clock: Clock, orders: FaultCommands | None = None
    ) -> None:
        self._robot, self._clock = robot, clock
        self._orders = orders or FaultCommands()
        connection = robot.connection
        self._command_timeout_s = connection.command_timeout_s
        self._camera_hz = robot.camera_hz
        self._body = QuadrupedBody(robot.sitl)
        self._rehearsal = Rehearsal(scenario, self._body, math.radians(robot.sitl.camera.fov_deg))
        self._wire: _Wire | None = _Wire(robot)
        """None while it is cut."""
        self._using = threading.Lock()
        """Held while publishing or cutting the link: Zenoh's sessions must not be closed meanwhile."""
        self._decoder = CommandDecoder(connection)
        self._command, self._obeyed_s = ZERO, -math.inf
        self._fault = Fault.NONE
        self._said: tuple[bytes, bytes, int] | None = None
        """The newest image, its truth and their stamp."""

    def serve(self, lifeline_ended: threading.Event) -> None:
        """Run until the parent process has ended and the robot stands, or `LINGER_S` after that end."""
        filming_ended = threading.Event()
        filming = self._rehearsal.film(self._clock, self._camera_hz, self._publish, filming_ended)
        try:
            self._walk(lifeline_ended)
        finally:
            filming_ended.set()
            filming.join()
            self._mend(cut=True)

    def _walk(self, lifeline_ended: threading.Event) -> None:
        give_up_s, deaf_until_s = math.inf, 0.0
        looked_s, last_ns = time.monotonic(), self._clock.now_ns()
        pacer = Pacer(MonotonicClock(), LOOK_HZ)
        while True:
            pacer.wait()
            now_s, now_ns = time.monotonic(), self._clock.now_ns()
            if now_s - looked_s > STALE_S:
                deaf_until_s = now_s + DEAF_S
            looked_s = now_s
            self._mend(cut=LINK_DROP.name in self._orders.faults)
            self._listen(now_s, deaf=now_s < deaf_until_s)
            if lifeline_ended.is_set():
                self._command = ZERO
                give_up_s = min(give_up_s, now_s + LINGER_S)
                if self._body.velocity == ZERO or now_s > give_up_s:
                    self._orders.witness.off()
                    return
            passed_s = min((now_ns - last_ns) / 1e9, LONGEST_LAG_S * self._clock.speed)
            last_ns = now_ns
            self._rehearsal.step(self._command, passed_s)
            self._orders.witness.speed(math.hypot(self._body.velocity.vx, self._body.velocity.vy))
            if self._wire is not None:
                self._wire.senses.tell(self._body, self._faults, now_ns, time.time_ns())

    def _mend(self, *, cut: bool) -> None:
        """Cut or restore the robot's network connection, including its router, if needed."""
        with self._using:
            if cut and self._wire is not None:
                self._wire.session.close()
                self._wire = None
            elif not cut and self._wire is None:
                self._wire = _Wire(self._robot)

    def _listen(self, now_s: float, *, deaf: bool) -> None:
        """Read incoming messages, of the commands only the newest; stop if there is a reason to."""
        host_left, wire = False, self._wire
        if wire is not None:
            if wire.goes.try_recv() is not None:
                self._rehearsal.go()
            if (wanted := wire.faults.try_recv()) is not None:
                self._fault = _fault(bytes(wanted.payload)) or self._fault
            sample = wire.commands.try_recv()
            if sample is not None and not deaf:
                self._obey(sample, now_s)
            while (change := wire.hosts.try_recv()) is not None:
                host_left = change.kind == zenoh.SampleKind.DELETE
        if host_left or deaf or now_s - self._obeyed_s > self._command_timeout_s:
            self._command = ZERO

    def _obey(self, sample: zenoh.Sample, now_s: float) -> None:
        attached = bytes(sample.attachment) if sample.attachment is not None else None
        command = self._decoder.take(bytes(sample.payload), attached, time.time_ns())
        if command is not None:
            self._orders.witness.command(command)
            self._command, self._obeyed_s = command, now_s

    @property
    def _faults(self) -> frozenset[Fault]:
        """Return its active faults, however they were requested."""
        return frozenset({self._fault, *(ORDERED[name] for name in self._orders.faults & ORDERED.keys())})

    def _publish(self, shot: Shot) -> None:
        """Publish an image after its ground truth; called from the camera's thread."""
        faults = self._faults
        if Fault.SILENT in faults or CAMERA_GONE.name in self._orders.faults:
            return
        if Fault.FROZEN_CAMERA not in faults or self._said is None:
            stamp_ns = time.time_ns()
            image = CompressedImage(stamp_ns, "jpeg", memoryview(shot.jpeg))
            truth = encode_stamped_truth(stamp_ns, shot.truth)
            self._said = (encode_compressed_image(image), truth, stamp_ns)
        payload, truth, stamp_ns = self._said
        with self._using:
            if self._wire is not None:
                self._wire.truths.put(truth, stamp_ns)
                self._wire.images.put(payload, stamp_ns)


class _Wire:
    """The robot's session, which is also the router, with its subscribers and publishers.

    Raises:
        PlatformError: it cannot listen at its endpoint.
    """

    def __init__(self, robot: Robot) -> None:
        connection = robot.connection
        try:
            self.session = zenoh.open(zenoh_config(connection, mode="router"))
        except zenoh.ZError as error:
            raise PlatformError(
                f"cannot listen at {connection.endpoint}: is another rehearsal or router running there?"
            ) from error
        session, keys, sitl_keys = self.session, Keys(connection), SitlKeys(connection)
        latest = zenoh.handlers.RingChannel
        self.commands = session.declare_subscriber(keys.command, latest(1))
        self.goes = session.declare_subscriber(sitl_keys.go, latest(1))
        self.faults = session.declare_subscriber(sitl_keys.fault, latest(1))
        live = session.liveliness()
        self.hosts = live.declare_subscriber(connection.host_token, latest(64), history=True)
        self._tokens = [
            live.declare_token(key) for key in (sitl_keys.alive, sitl_keys.run, keys.robot_token) if key
        ]
        self.senses = Senses(session, connection, robot.sitl)
        self.images = Publisher(session, keys.camera, attaches=keys.attaches)
        self.truths = Publisher(session, sitl_keys.truth, attaches=False)


def _fault(payload: bytes) -> Fault | None:
    try:
        return Fault(payload.decode())
    except ValueError:
        return None
