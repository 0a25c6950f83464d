"""The simulated rover's own rules: whom it obeys, and when it stops by itself. Pure: time is an argument."""

from __future__ import annotations

import math

from adatracker_deploy import ZERO, Pose

from adatracker_rover.protocol.messages import Ask, Mode, Report, decode_request, encode_report
from adatracker_rover.sim.dynamics import RoverBody
from adatracker_rover.sim.settings import SitlSettings


class Rover:
    """One rover, switched on.

    Args:
        settings: of the simulated rover.
        seed: of its dynamics.
        now_s: the time, s.
        speed: times real time; a loss of commands takes as long to notice however fast the rehearsal.
    """

    def __init__(self, settings: SitlSettings, seed: int, now_s: float, speed: float = 1.0) -> None:
        self.mode = Mode.IDLE
        self._settings = settings
        self._timeout_s = settings.command_timeout_s * speed or math.inf
        self._body = RoverBody(settings)
        self._body.reset(Pose(), seed)
        self._command = ZERO
        self._now_s = self._heard_s = now_s

    @property
    def at_rest(self) -> bool:
        """It stands, and no host drives it."""
        return self.mode is not Mode.DRIVE and abs(self._body.velocity.vx) < 0.01

    def receive(self, data: bytes) -> bool:
        """Obey one datagram, as of the last step; tell whether it was a request."""
        request = decode_request(data)
        if request is None:
            return False
        if self.mode is Mode.REMOTE:
            return True
        if request.ask is Ask.STOP:
            self._stop(Mode.IDLE)
        elif request.ask is Ask.ENABLE and self.mode is not Mode.DRIVE:
            self.mode, self._heard_s = Mode.DRIVE, self._now_s
        elif request.ask is Ask.DRIVE and self.mode is Mode.DRIVE:
            self._command, self._heard_s = request.velocity, self._now_s
        return True

    def step(self, now_s: float) -> None:
        """Go on to `now_s`."""
        if self.mode is Mode.DRIVE and now_s - self._heard_s > self._timeout_s:
            self._stop(Mode.TIMED_OUT)
        self._body.step(self._command, now_s - self._now_s)
        self._now_s = now_s

    def take_over(self) -> None:
        """Do what a person with the remote control does: stop it and keep it."""
        self._stop(Mode.REMOTE)

    def report(self) -> bytes:
        """Return the datagram that says how it is."""
        settings, body = self._settings, self._body
        return encode_report(
            Report(self.mode, settings.battery, settings.command_timeout_s, body.pose, body.velocity)
        )

    def _stop(self, mode: Mode) -> None:
        self.mode, self._command = mode, ZERO
