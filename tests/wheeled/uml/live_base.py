"""A simulated base on a real SocketCAN bus: the package's own controller and body, with no world around."""

from __future__ import annotations

import contextlib
import socket
import threading
from typing import TYPE_CHECKING

import can

from adatracker_deploy.core.clock import MonotonicClock
from adatracker_deploy.runtime.pacer import Pacer
from adatracker_wheeled.protocol.frames import CanFrame
from adatracker_wheeled.sim.dynamics import WheeledBody
from adatracker_wheeled.sim.firmware import Base

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.config.profile import Profile

RATE_HZ = 100.0
REST_M_S = 0.02
CLOCK = MonotonicClock()


class LiveBase:
    """A base with its power on, in a thread; whenever it has lost its bus it tries to open it again."""

    def __init__(self, profile: Profile, channel: str) -> None:
        self.base = Base(profile.connection.roles, profile.sitl)
        self.body = WheeledBody(profile.sitl, profile.connection.roles)
        self.frames = 0
        """Number of frames received."""
        self.heard_ns = 0
        """Time of the newest, by `CLOCK`, exact to one step."""
        self._channel = channel
        self._bus: can.BusABC | None = None
        self._stepped = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def speed_m_s(self) -> float:
        """True forward speed of the body, m/s."""
        return self.body.velocity.vx

    def wait_until(self, condition: Callable[[], bool], limit_s: float) -> int:
        """Return the time, by `CLOCK`, of a step after which the condition holds.

        Raises:
            AssertionError: there is none within the limit.
        """
        with self._stepped:
            assert self._stepped.wait_for(condition, limit_s), f"not within {limit_s:g} s"
            return CLOCK.now_ns()

    def wait_until_at_rest(self, limit_s: float) -> int:
        """Wait until it moves by less than 2 cm/s."""
        return self.wait_until(lambda: abs(self.speed_m_s) < REST_M_S, limit_s)

    def close(self) -> None:
        """Switch the power off."""
        self._closed = True
        self._thread.join()
        self._hang_up()

    def _run(self) -> None:
        pacer = Pacer(CLOCK, RATE_HZ)
        begun_ns = last_ns = CLOCK.now_ns()
        while not self._closed:
            now_ns = pacer.wait().t_ns
            now_s, dt_s, last_ns = (now_ns - begun_ns) / 1e9, (now_ns - last_ns) / 1e9, now_ns
            try:
                self._exchange(now_s)
            except (can.CanError, OSError):
                self._hang_up()
            with self._stepped:
                self.body.step(self.base.demand(now_s), dt_s)
                self._stepped.notify_all()

    def _exchange(self, now_s: float) -> None:
        if self._bus is None:
            socket.if_nametoindex(self._channel)  # python-can would log every vain attempt
            self._bus = can.Bus(interface="socketcan", channel=self._channel)
        while message := self._bus.recv(0):
            self.frames, self.heard_ns = self.frames + 1, CLOCK.now_ns()
            self.base.receive(CanFrame(message.arbitration_id, bytes(message.data)), now_s)
        for frame in self.base.transmit(self.body.measured, self.body.wheels_m, now_s):
            self._bus.send(can.Message(arbitration_id=frame.id, data=frame.data, is_extended_id=False))

    def _hang_up(self) -> None:
        bus, self._bus = self._bus, None
        if bus is not None:
            with contextlib.suppress(can.CanError, OSError):
                bus.shutdown()
