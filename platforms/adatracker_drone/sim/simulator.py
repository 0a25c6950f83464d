"""The simulator's main loop: steps a body and its autopilot on the shared clock, and serves their links."""

from __future__ import annotations

import contextlib
import math
import select
import socket
import threading
import time

from pymavlink.dialects.v20 import common as mavlink

from adatracker_deploy.core.clock import Clock
from adatracker_deploy.core.faults import BATTERY_LOW, LINK_DROP, ROBOT_SILENT, TAKEOVER
from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.sim.process import FaultCommands
from adatracker_drone.protocol.packets import signing_time
from adatracker_drone.protocol.px4 import Mode
from adatracker_drone.sim.autopilot import COMPONENT, NOBODY, Autopilot, Identity, velocity_of
from adatracker_drone.sim.dynamics import STEP_S, DroneBody
from adatracker_drone.sim.settings import SitlSettings
from adatracker_drone.sim.telemetry import Message

BATCH_S = 0.004
"""Machine time between two looks at the sockets."""
LONGEST_LAG_S = 0.25
"""A process that was kept from running for longer skips the time instead of rushing through it."""
LINGER_S = 60.0
"""Machine time that the vehicle has to come to rest after its parent process has ended."""
_LOW_BATTERY = 0.05
_MOST_DATAGRAMS = 200
"""Largest number read at once: a flood must not keep the vehicle from being flown."""


class Wire:
    """One UDP link, to and from one address only.

    Args:
        address: that one.
        key: the secret that both ends share, with which every message is signed; None signs nothing.
        system: the sender's system id.
    """

    def __init__(self, address: tuple[str, int], key: bytes | None = None, system: int = 1) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.socket.connect(address)  # from then on it hears nobody else
        self._packer = mavlink.MAVLink(None, srcSystem=system, srcComponent=COMPONENT)
        self._signing = self._packer.signing
        self._signing.secret_key, self._signing.sign_outgoing = key, key is not None
        self._to_ground_station = False
        """A ground station's HEARTBEAT was heard: PX4 sends its texts to those alone."""

    def receive(self) -> list[Message]:
        """Return the decoded messages that have come in; bytes that are no message are dropped."""
        messages: list[Message] = []
        with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
            for _ in range(_MOST_DATAGRAMS):
                data = self.socket.recv(65535)
                # A datagram holds whole messages: a new parser for each keeps no rubbish for the next.
                parser = mavlink.MAVLink(None)
                parser.robust_parsing = True
                parser.signing = self._signing  # with a key it raises for what is not signed with it
                with contextlib.suppress(Exception):  # whatever a hostile datagram provokes ends with it
                    messages += parser.parse_buffer(data) or []
        self._to_ground_station = self._to_ground_station or any(map(_is_ground_stations, messages))
        return messages

    def send(self, messages: list[Message]) -> None:
        """Send each message in a datagram of its own; a full or absent receiver loses it."""
        self._signing.timestamp = max(self._signing.timestamp, signing_time(time.time_ns()))
        for message in messages:
            if message.get_type() == "STATUSTEXT" and not self._to_ground_station:
                continue
            with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
                self.socket.send(message.pack(self._packer))


def _is_ground_stations(message: Message) -> bool:
    return bool(message.get_type() == "HEARTBEAT" and message.type == mavlink.MAV_TYPE_GCS)


class Simulator:
    """One vehicle, standing on the ground with its power on, and its links."""

    def __init__(
        self,
        settings: SitlSettings,
        seed: int,
        speed: float,
        addresses: list[tuple[str, int]],
        *,
        key: bytes | None = None,
        orders: FaultCommands | None = None,
        identity: Identity = NOBODY,
    ) -> None:
        """Switch it on.

        Args:
            settings: of the simulated vehicle.
            seed: of its wind and its estimation errors.
            speed: times real time; see `Autopilot`.
            addresses: where each link sends.
            key: with which all of them are signed; None signs nothing.
            orders: fault commands, and where they are reported. All links but the first, which are for ground
                stations, stay free of faults.
            identity: who it is.

        Raises:
            UsageError: a PX4 parameter in the settings does not exist or is out of range.
        """
        self._autopilot = Autopilot(settings, seed, speed, identity)
        self._body = DroneBody(settings)
        self._body.reset(Pose(yaw=math.radians(settings.yaw_deg)), seed)
        self._wires = [Wire(address, key, identity.system) for address in addresses]
        self._orders = orders or FaultCommands()
        self._piloted = False
        self._ticks = 0

    @property
    def source_port(self) -> int:
        """The UDP port that the first link sends from."""
        return int(self._wires[0].socket.getsockname()[1])

    def serve(self, clock: Clock, lifeline_ended: threading.Event) -> None:
        """Run until the parent process has ended and the vehicle rests, or `LINGER_S` after that end."""
        power_on_ns = deadline_ns = clock.now_ns()
        batch_ns = round(max(BATCH_S * clock.speed, STEP_S) * 1e9)
        give_up_s = math.inf
        while True:
            behind_s = (clock.now_ns() - power_on_ns) / 1e9 - self._ticks * STEP_S
            if behind_s > LONGEST_LAG_S * clock.speed:
                power_on_ns += round(behind_s * 1e9)
            self._advance((clock.now_ns() - power_on_ns) / 1e9)
            if lifeline_ended.is_set():
                give_up_s = min(give_up_s, time.monotonic() + LINGER_S)
                if self._autopilot.at_rest or time.monotonic() > give_up_s:
                    self._send(self._autopilot.farewell())
                    self._orders.witness.off()
                    return
            deadline_ns = max(deadline_ns + batch_ns, clock.now_ns())
            self._wait((deadline_ns - clock.now_ns()) / 1e9 / clock.speed)

    def _advance(self, until_s: float) -> None:
        """Hear, fly and tell, up to a time since power-on."""
        if BATTERY_LOW.name in self._orders.faults:
            self._autopilot.drain(_LOW_BATTERY)
        self._let_the_pilot_fly(TAKEOVER.name in self._orders.faults)
        for wire in self._wires:
            cut = wire is self._wires[0] and LINK_DROP.name in self._orders.faults
            for message in wire.receive():
                if (told := velocity_of(message)) is not None:
                    self._orders.witness.command(told)  # also one that is sent in vain
                if not cut:
                    self._autopilot.receive(message)
        while (self._ticks + 1) * STEP_S <= until_s:
            self._ticks += 1
            demand = self._autopilot.step(self._body.motion, self._ticks * STEP_S)
            self._body.power = self._autopilot.power()
            self._body.step(Twist(demand.forward, -demand.right, -demand.down, -demand.yaw_rate), STEP_S)
            self._send(self._autopilot.transmit())
        velocity = self._body.velocity
        self._orders.witness.speed(math.hypot(velocity.vx, velocity.vy))
        self._orders.witness.flight(velocity.vz, self._body.pose.z)
        commander = self._autopilot.commander
        self._orders.witness.mode(commander.mode.name, armed=commander.armed)

    def _let_the_pilot_fly(self, piloted: bool) -> None:
        """Switch to position mode when the fault begins, as a pilot does with the remote control."""
        if piloted and not self._piloted:
            commander = self._autopilot.commander
            commander.request(Mode.POSCTL, self._ticks * STEP_S)
        self._piloted = piloted

    def _send(self, messages: list[Message]) -> None:
        mute = self._orders.faults & {LINK_DROP.name, ROBOT_SILENT.name}
        for wire in self._wires[1:] if mute else self._wires:
            wire.send(messages)

    def _wait(self, timeout_s: float) -> None:
        """Wait for a message, at most so long in machine time."""
        select.select([wire.socket for wire in self._wires], [], [], max(0.0, timeout_s))
