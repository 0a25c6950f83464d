"""A simulated base on a virtual CAN bus in this process, and what tests do with an adapter on it."""

import contextlib
import dataclasses
import itertools
import threading
import time

import can

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.platform import Scenario
from adatracker_deploy.registry import load_profile
from adatracker_wheeled.platform import WheeledPlatform
from adatracker_wheeled.protocol.bus import Bus
from adatracker_wheeled.protocol.codec import Codec
from adatracker_wheeled.protocol.frames import CanFrame, Malformed
from adatracker_wheeled.sim.faults import ON_DEMAND, injection
from adatracker_wheeled.sim.simulator import Simulator
from tests.in_a_thread import SitlInAThread

_numbers = itertools.count()


def base_profile(name="scout", *, channel=None, **sitl):
    """A shipped profile on a virtual bus of its own."""
    profile = load_profile(name, WheeledPlatform)
    channel = channel or f"test-{next(_numbers)}"
    return dataclasses.replace(
        profile,
        connection=dataclasses.replace(profile.connection, interface="virtual", channel=channel),
        sitl=dataclasses.replace(profile.sitl, **sitl),
    )


class InProcess(SitlInAThread):
    """The simulator of `WheeledSitl`, in a thread and behind a virtual bus."""

    faults = ON_DEMAND

    def start(self, clock, scenario):
        connection, sitl = self._profile.connection, self._profile.sitl
        self.simulator = Simulator(connection.roles, sitl, scenario, clock, self._orders)
        self.bus = Bus.open(connection, lambda frame: self.simulator.hear(frame) if frame else None)
        self.serve(self.simulator, self.bus.send)
        return self._profile

    def inject(self, fault, *, begin=True):
        self.simulator.hear(injection(fault, begin=begin))

    def close(self):
        super().close()
        if self._thread is not None:
            self.bus.close()


class Tap:
    """A third node on a virtual bus, which receives the frames of the adapter and the base."""

    def __init__(self, profile):
        self.codec = Codec(profile.connection.roles)
        self._bus = can.Bus(interface="virtual", channel=profile.connection.channel)

    def frames(self):
        """Return all frames since the last call, including the base's own."""
        return list(iter(lambda: self._bus.recv(0), None))

    def commands(self):
        """Return the frames that the adapter has sent since the last call, as (id, data)."""
        return [(m.arbitration_id, bytes(m.data)) for m in self.frames() if self.is_demand(m)]

    def commands_until_quiet(self, quiet_s=0.1):
        """Listen until the adapter has been silent for a while; return what it sent."""
        said, heard_s = [], time.monotonic()
        while time.monotonic() - heard_s < quiet_s:
            if new := self.commands():
                said, heard_s = said + new, time.monotonic()
            threading.Event().wait(0.005)
        return said

    def is_demand(self, message):
        """Tell whether a frame asks something of the base."""
        with contextlib.suppress(Malformed):
            frame = CanFrame(message.arbitration_id, bytes(message.data), message.is_extended_id)
            return self.codec.parse_command(frame) is not None
        return False

    def send(self, number, data):
        self._bus.send(can.Message(arbitration_id=number, data=data, is_extended_id=False))

    def close(self):
        self._bus.shutdown()


STANDBY, COMMAND_MODE, STILL = (0x421, b"\x00"), (0x421, b"\x01"), (0x111, bytes(8))
"""Frames of AgileX's protocol v2."""


@contextlib.contextmanager
def drive(profile=None, clock=None):
    """A connected adapter and its base; give (adapter, simulator)."""
    profile, clock = profile or base_profile(), clock or MonotonicClock()
    with InProcess(profile) as sitl, WheeledPlatform(sitl.start(clock, Scenario(seed=1)), clock) as platform:
        platform.connect()
        yield platform, sitl


def until(condition, within_s=5.0):
    """Wait for a condition; return the seconds that it took."""
    pause, begin_s = threading.Event(), time.monotonic()
    while not condition():
        assert time.monotonic() - begin_s < within_s, "waited in vain"
        pause.wait(0.002)
    return time.monotonic() - begin_s


@contextlib.contextmanager
def tapped(profile=None, clock=None):
    """Give a connected adapter, its base, and a `Tap` on their bus."""
    profile = profile or base_profile()
    with contextlib.closing(Tap(profile)) as tap, drive(profile, clock) as (platform, simulator):
        yield platform, simulator, tap
