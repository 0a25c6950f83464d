"""Who steers the drone: set-points leave only while there is consent.

Consent is given by an explicit engage. It is taken away, at once and from any thread, by a stop, by a mode
that nobody here asked for, and when the drone is no longer heard; and it never comes back by itself.
"""

from __future__ import annotations

import contextlib
import threading
from typing import TYPE_CHECKING

from adatracker_deploy.errors import PlatformError
from adatracker_deploy.platform import ZERO, Twist
from adatracker_drone.protocol import AltitudeHold

if TYPE_CHECKING:
    from adatracker_deploy.runtime.clock import Clock
    from adatracker_drone.connection import Connection
    from adatracker_drone.vehicle import Heard, Vehicle

_LONGEST_REASON = 95
"""As `PlatformState.stopped` promises."""


class Helm:
    """Guards one vehicle's set-points; every method returns at once."""

    def __init__(self, connection: Connection, clock: Clock) -> None:
        self.engaged = False
        """OFFBOARD was confirmed and nothing has ended it."""
        self.in_charge = False
        """What the vehicle does now was asked for by this side, so this side has to land it."""
        self.stopped = ""
        """Why consent went; empty while nothing unusual has happened."""
        self.taken_over = False
        """It went because the vehicle's mode changed, and nobody here had asked for that."""
        self.ground_down_m = 0.0
        """Where the drone took off, in PX4's local frame."""
        self._connection = connection
        self._clock = clock
        self._lock = threading.RLock()
        self._consent = False
        self._expected: frozenset[str] = frozenset()
        self._altitude_hold: AltitudeHold | None = None

    def give_consent(self) -> None:
        """Let set-points out; forgets why they were stopped."""
        with self._lock:
            self._consent, self.stopped, self.taken_over = True, "", False

    def withdraw(self, vehicle: Vehicle | None = None, reason: str = "") -> None:
        """Let nothing out any more but a last zero, to a `vehicle` that is flown; the first reason stays."""
        with self._lock:
            if vehicle is not None and self.engaged:
                with contextlib.suppress(PlatformError):  # a radio that fails must not keep consent alive
                    self._transmit(vehicle, ZERO, self._clock.now_ns())
            self.stopped = self.stopped or reason[:_LONGEST_REASON]  # first, for who reads without the lock
            self._consent = self.engaged = False
            self._expected, self._altitude_hold = frozenset(), None

    def take_charge(self) -> None:
        """From now on this side has to bring the drone down again.

        Raises:
            PlatformError: consent has gone.
        """
        with self._lock:
            self.require_consent()
            self.in_charge = True

    def expect(self, vehicle: Vehicle, *modes: str) -> None:
        """Take any mode but these, now or in any later HEARTBEAT, for somebody else taking over."""
        with self._lock:
            self._expected = frozenset(modes)
            self.on_mode(vehicle.heard.mode)

    def on_mode(self, mode: str) -> None:
        """Judge the mode that a HEARTBEAT told: one that is not expected is obeyed by letting go."""
        with self._lock:
            if self._expected and mode not in self._expected:
                self.in_charge = False
                self.taken_over = True
                self.withdraw(reason=f"the drone went to {mode} by its pilot or its own fail-safe")

    def keep_alive(self, vehicle: Vehicle) -> None:
        """Send a zero set-point while engaging.

        Raises:
            PlatformError: consent has gone.
        """
        with self._lock:
            self.require_consent()
            self._transmit(vehicle, ZERO, self._clock.now_ns())

    def hold_altitude(self, vehicle: Vehicle, band_m: tuple[float, float]) -> None:
        """From now on add to every set-point what keeps the present altitude, inside a band."""
        with self._lock:
            altitude_m = self.altitude_m(vehicle.heard)
            self._altitude_hold = AltitudeHold.at(altitude_m, band_m, self._clock.now_ns())

    def engage(self, vehicle: Vehicle) -> None:
        """Let commands through: the vehicle was seen in OFFBOARD.

        Raises:
            PlatformError: consent has gone, or the vehicle has left OFFBOARD already.
        """
        with self._lock:
            self.expect(vehicle, "OFFBOARD")
            self.require_consent()
            self.engaged = True

    def steer(self, vehicle: Vehicle, command: Twist, now_ns: int) -> Twist:
        """Send one command with the altitude hold's climb rate added; return what was sent.

        Raises:
            PlatformError: not engaged, or nothing was heard of the drone's position for too long.
        """
        with self._lock:
            if not self.engaged:
                raise PlatformError(f"not engaged: {self.stopped or 'engage first'}")
            silent_s = (now_ns - vehicle.heard.position_t_ns) / 1e9 / self._clock.speed
            if silent_s > self._connection.telemetry_timeout_s:
                self.withdraw(reason=f"no position from the drone for {silent_s:.1f} s")
                raise PlatformError(f"stopped: {self.stopped}")
            return self._transmit(vehicle, command, now_ns)

    def altitude_m(self, heard: Heard) -> float:
        """Return the height above where the drone took off."""
        return 0.0 if heard.position_ned_m is None else self.ground_down_m - heard.position_ned_m[2]

    def require_consent(self) -> None:
        """Do nothing, or raise PlatformError when consent has gone."""
        if not self._consent:
            raise PlatformError(f"engaging was stopped: {self.stopped or 'disengage or close was asked for'}")

    def _transmit(self, vehicle: Vehicle, command: Twist, now_ns: int) -> Twist:
        if self._altitude_hold is not None:
            altitude_m = self.altitude_m(vehicle.heard)
            self._altitude_hold, climb = self._altitude_hold.step(command.vz, altitude_m, now_ns)
            command = Twist(command.vx, command.vy, climb, command.yaw_rate)
        vehicle.send_velocity(command, now_ns)
        return command
