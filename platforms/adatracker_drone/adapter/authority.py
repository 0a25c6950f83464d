"""Control authority: set-points and commands are sent only while this side may control the drone.

An explicit engage gives consent. A stop, an unrequested mode change, lost telemetry or a delay of this side
revokes it, at once and from any thread; it never comes back by itself. HOLD and LAND may still be needed
then; they require that this side is in charge of the drone. After an unrequested mode change, somebody else
is.
"""

from __future__ import annotations

import contextlib
import threading
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import LONGEST_REASON, ZERO, Twist
from adatracker_deploy.runtime.suspend import SuspendWatch
from adatracker_drone.protocol.setpoints import AltitudeHold

if TYPE_CHECKING:
    from adatracker_deploy.core.clock import Clock
    from adatracker_drone.adapter.commands import VehicleCommand
    from adatracker_drone.adapter.transport import Vehicle
    from adatracker_drone.adapter.vehicle_state import VehicleState
    from adatracker_drone.protocol.connection import Connection


class ControlAuthority:
    """Guards everything sent to one vehicle; every method returns at once."""

    def __init__(self, connection: Connection, clock: Clock) -> None:
        self.engaged = False
        """OFFBOARD was confirmed and has not ended."""
        self.in_charge = False
        """This side requested the vehicle's current mode, so it has to land the vehicle."""
        self.stopped = ""
        """Reason for revoking consent; empty if nothing unusual has happened."""
        self.taken_over = False
        """Consent was revoked by an unrequested mode change."""
        self.ground_down_m = 0.0
        """Height of the take-off point in PX4's local frame, positive down."""
        self.loss_s = 1.0
        """Time without a set-point after which the autopilot's own fail-safe acts (COM_OF_LOSS_T)."""
        self._connection = connection
        self._clock = clock
        self._lock = threading.RLock()
        self._consent = False
        self._expected: frozenset[str] = frozenset()
        self._altitude_hold: AltitudeHold | None = None
        self._sent_ns = 0
        """Time of the last set-point."""
        self._suspends = SuspendWatch(clock)

    def give_consent(self) -> None:
        """Allow set-points; clears the reason for the last stop."""
        with self._lock:
            self._consent, self.stopped, self.taken_over = True, "", False
            self._suspends.begin()
            if not self.in_charge:
                self._expected = frozenset()

    def withdraw(self, vehicle: Vehicle | None = None, reason: str = "") -> None:
        """Revoke consent, after a last zero to a `vehicle` in flight; the first reason is kept.

        No zero is sent if the last set-point is so old that the autopilot may be landing by its own
        fail-safe: it would return PX4 to OFFBOARD.
        """
        with self._lock:
            if vehicle is not None and self.engaged and not self._out_of_time():
                with contextlib.suppress(PlatformError):  # a failing radio must not keep consent alive
                    self._transmit(vehicle, ZERO, self._clock.now_ns())
            self.stopped = self.stopped or reason[:LONGEST_REASON]  # first, for who reads without the lock
            self._consent = self.engaged = False
            self._altitude_hold = None

    def take_charge(self) -> None:
        """Take charge: from now on this side has to land the drone.

        Raises:
            PlatformError: consent was revoked.
        """
        with self._lock:
            self.require_consent()
            self.in_charge = True

    def release(self) -> None:
        """Give up charge of the vehicle: it stands, or somebody else controls it."""
        with self._lock:
            self.in_charge, self._expected = False, frozenset()

    def expect(self, vehicle: Vehicle, *modes: str) -> None:
        """Treat any mode but these, now or later, as a takeover."""
        with self._lock:
            self._expected = frozenset(modes)
            self.on_mode(vehicle.heard.mode)

    def on_mode(self, mode: str) -> None:
        """Handle a reported mode: an unexpected one is a takeover."""
        with self._lock:
            if self._expected and mode not in self._expected:
                self.lose(f"the drone went to {mode} by its pilot or its own fail-safe")

    def lose(self, reason: str) -> None:
        """Leave the vehicle to whoever took it over."""
        with self._lock:
            self.taken_over = True
            self.withdraw(reason=reason)
            self.release()

    def order(self, vehicle: Vehicle, order: VehicleCommand, *modes: str) -> None:
        """Send a command that leads towards flight; from now on `modes` are expected too.

        Raises:
            PlatformError: consent was revoked.
        """
        with self._lock:
            self._require_alone(vehicle)
            self.require_consent()
            self._expected |= frozenset(modes)
            vehicle.order(order)

    def order_down(self, vehicle: Vehicle, order: VehicleCommand, *modes: str) -> bool:
        """Send a command that leads towards rest, without consent; return False, sending none, if not in
        charge."""
        with self._lock:
            if not self.in_charge:
                return False
            self._expected |= frozenset(modes) if self._expected else frozenset()
            vehicle.order(order)
            return True

    def keep_alive(self, vehicle: Vehicle) -> None:
        """Send a zero set-point while engaging.

        Raises:
            PlatformError: consent was revoked.
        """
        with self._lock:
            self._require_alone(vehicle)
            self.require_consent()
            self._transmit(vehicle, ZERO, self._clock.now_ns())

    def hold_altitude(self, vehicle: Vehicle, band_m: tuple[float, float]) -> None:
        """From now on hold the present altitude, within a band, with every set-point."""
        with self._lock:
            altitude_m = self.altitude_m(vehicle.heard)
            self._altitude_hold = AltitudeHold.at(altitude_m, band_m, self._clock.now_ns())

    def engage(self, vehicle: Vehicle) -> None:
        """Allow commands: the vehicle was seen in OFFBOARD.

        Raises:
            PlatformError: consent was revoked, or the vehicle has left OFFBOARD already.
        """
        with self._lock:
            self.expect(vehicle, "OFFBOARD")
            self.require_consent()
            self._sent_ns = self._clock.now_ns()
            self.engaged = True

    def steer(self, vehicle: Vehicle, command: Twist, now_ns: int) -> Twist:
        """Send one command with the altitude hold's climb rate added; return what was sent.

        Raises:
            PlatformError: not engaged, nothing was heard of the drone's position for too long, this side has
                been silent or suspended itself, or somebody else is heard where nobody may be.
        """
        with self._lock:
            if not self.engaged:
                raise PlatformError(f"not engaged: {self.stopped or 'engage first'}")
            silent_s = self._seconds_since(vehicle.heard.position_t_ns, now_ns)
            if silent_s > self._connection.telemetry_timeout_s:
                self.withdraw(reason=f"no position from the drone for {silent_s:.1f} s")
            elif why := self._out_of_time():
                self.withdraw(reason=why)
            self._require_alone(vehicle)
            if not self.engaged:
                raise PlatformError(f"stopped: {self.stopped}")
            return self._transmit(vehicle, command, now_ns)

    def altitude_m(self, heard: VehicleState) -> float:
        """Return the height above where the drone took off."""
        return 0.0 if heard.position_ned_m is None else self.ground_down_m - heard.position_ned_m[2]

    def require_consent(self) -> None:
        """Raise PlatformError if consent was revoked."""
        with self._lock:
            if self._consent and (slept := self._suspends.trouble()):
                self.withdraw(reason=slept)
            if not self._consent:
                raise PlatformError(
                    f"engaging was stopped: {self.stopped or 'disengage or close was asked for'}"
                )

    def _require_alone(self, vehicle: Vehicle) -> None:
        """Withdraw consent if another sender is heard where none is allowed."""
        if self._connection.alone and vehicle.foreign_datagrams:
            self.withdraw(vehicle, f"somebody else sends on the link: {vehicle.ignored}")

    def _out_of_time(self) -> str:
        """Return why this side's next set-point would come too late after the last; empty if it would not."""
        silent_s = self._seconds_since(self._sent_ns, self._clock.now_ns())
        if silent_s > self.loss_s / 2:
            return f"no set-point went out for {silent_s:.1f} s: the autopilot's own fail-safe acts"
        return self._suspends.trouble()

    def _seconds_since(self, t_ns: int, now_ns: int) -> float:
        """Return the machine's seconds from one time of the run's clock to another."""
        return (now_ns - t_ns) / 1e9 / self._clock.speed

    def _transmit(self, vehicle: Vehicle, command: Twist, now_ns: int) -> Twist:
        if self._altitude_hold is not None:
            altitude_m = self.altitude_m(vehicle.heard)
            self._altitude_hold, climb = self._altitude_hold.step(command.vz, altitude_m, now_ns)
            command = Twist(command.vx, command.vy, climb, command.yaw_rate)
        vehicle.send_velocity(command, now_ns)
        self._sent_ns = self._clock.now_ns()
        return command
