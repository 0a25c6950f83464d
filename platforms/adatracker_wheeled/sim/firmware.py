"""The simulated base's firmware: answers CAN frames and drives the wheels.

Pure: frames, the wheels' motion and the time go in; frames and a velocity demand come out. Its rules are
those that AgileX's manuals state: the remote control always overrides, commands count in command mode only,
and without one for half a second the base stops.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_wheeled.protocol.codec import Codec
from adatracker_wheeled.protocol.frames import BaseStatus, CanFrame, Malformed, Mode, Reading
from adatracker_wheeled.sim.faults import parse_injection

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_wheeled.protocol.roles import Roles
    from adatracker_wheeled.sim.settings import FaultName, SitlSettings

_EMPTY_V, _FULL_V = 21.0, 29.4
"""Voltages of an empty and a full battery of seven lithium cells."""
_LOW = 0.05


class _Stream:
    """One kind of message, sent periodically."""

    def __init__(self, encode: Callable[[Reading, int], tuple[CanFrame, ...]], period_s: float) -> None:
        self._encode = encode
        self._period_s = period_s
        self._due_s = -math.inf
        self._count = 0
        self._last: tuple[CanFrame, ...] = ()

    def due(self, reading: Reading, now_s: float, *, frozen: bool = False) -> tuple[CanFrame, ...]:
        """Return the frames if they are due; frozen ones are the last again, counter and all."""
        if now_s < self._due_s - 1e-9:
            return ()
        self._due_s += self._period_s
        if self._due_s <= now_s:  # what is late is not made up for
            self._due_s = now_s + self._period_s
        if not (frozen and self._last):
            self._last = self._encode(reading, self._count)
            self._count += 1
        return self._last


class Base:
    """One base.

    Args:
        roles: its messages, the same that the adapter reads.
        settings: of the simulated base.
        speed: of the clock that its times are of, against the machine's; its command time-out is in machine
            time, since its commander is as slow as the machine.

    Raises:
        UsageError: the roles do not fit the DBC.
    """

    def __init__(self, roles: Roles, settings: SitlSettings, speed: float = 1.0) -> None:
        self.faults: set[FaultName] = set(settings.faults)
        """Faults that are on now."""
        self.malformed = 0
        """Received frames that were dropped."""
        self.mode: Mode = "standby"
        self._codec = Codec(roles)
        self._roles = roles
        self._charge = settings.battery
        self._timeout_s = roles.timing.base_timeout_s * speed
        self._braked = bool(roles.release_brake)
        self._command = ZERO
        self._expires_s = 0.0
        self._state = _Stream(self._codec.status_frames, roles.timing.state_period_s)
        self._feedback = _Stream(self._codec.feedback_frames, roles.timing.feedback_period_s)
        self._battery = _Stream(self._codec.battery_frames, roles.timing.battery_period_s)
        self._obey_remote()

    def receive(self, frame: CanFrame, now_s: float) -> Twist | None:
        """Take in one frame; what is malformed, or for somebody else, changes nothing.

        Returns:
            The velocity that it asks for, obeyed or not; None if it asks for none.
        """
        if (injected := parse_injection(frame)) is not None:
            self.apply_faults(*injected)
            return None
        try:
            demand = self._codec.parse_command(frame)
        except Malformed:
            self.malformed += 1
            return None
        if demand is None:
            return None
        if demand.disable:
            self._enter("standby")
        if demand.enable or (demand.twist is not None and not self._roles.enable):
            self._enter("ours")
        if demand.release_brake and self.mode == "ours":
            self._braked = False
        if demand.twist is not None and self.mode == "ours":
            self._command, self._expires_s = demand.twist, now_s + self._timeout_s
        return demand.twist

    def apply_faults(self, fault: FaultName, begins: bool) -> None:
        """Let something begin, or end, to be wrong."""
        (self.faults.add if begins else self.faults.discard)(fault)
        self._obey_remote()

    def demand(self, now_s: float) -> Twist:
        """Return the velocity that the motors are asked for; zero whenever anything is wrong."""
        hindered = self._braked or self.faults & {"emergency_stop", "fault"}
        if self.mode != "ours" or hindered or now_s > self._expires_s:
            return ZERO
        return self._command

    def transmit(self, motion: Twist, wheels_m: tuple[float, float], now_s: float) -> tuple[CanFrame, ...]:
        """Return what is due by `now_s`.

        Args:
            motion: velocity that the wheels amount to.
            wheels_m: how far the left and the right ones have rolled.
            now_s: time since power-on.
        """
        charge = min(self._charge, _LOW) if "low_battery" in self.faults else self._charge
        volts = _EMPTY_V + charge * (_FULL_V - _EMPTY_V)
        status = self._report(volts)
        reading = Reading(status=status, motion=motion, wheels_m=wheels_m, battery=charge, volts=volts)
        frames = self._state.due(reading, now_s, frozen="frozen_state" in self.faults)
        frames += self._battery.due(reading, now_s)
        if "frozen_feedback" not in self.faults:
            frames += self._feedback.due(reading, now_s)
        return () if "silence" in self.faults else frames

    def _enter(self, mode: Mode) -> None:
        """Change modes, from zero; a remote control that is switched on decides alone."""
        if self.mode != mode:
            self.mode, self._command = mode, ZERO
            self._braked = bool(self._roles.release_brake)
        self._obey_remote()

    def _obey_remote(self) -> None:
        if "remote" in self.faults:
            self.mode, self._command = "remote", ZERO
        elif self.mode == "remote":
            self.mode = "standby"

    def _report(self, volts: float) -> BaseStatus:
        """Say what is wrong as far as this base has words for it."""
        words = self._roles.state
        silent_stop = "emergency_stop" in self.faults and not words.emergency_stop
        mode = "standby" if silent_stop or (self.mode == "remote" and not words.remote) else self.mode
        fault = next(iter(words.faults), "fault") if "fault" in self.faults else ""
        return BaseStatus(
            mode=mode,
            emergency_stop="emergency_stop" in self.faults and bool(words.emergency_stop),
            fault=fault,
            volts=volts,
        )
