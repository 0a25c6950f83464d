"""The drone's adapter: a PX4 quadrotor flown by body velocities in OFFBOARD.

Blocking operations (connecting, climbing, landing) share one lock. What must not wait (a stop, a set-point, a
takeover) goes through the `ControlAuthority`, so that a stop from another thread ends an engage at once.
"""

from __future__ import annotations

import contextlib
import threading
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.core.messages import PlatformState, Twist
from adatracker_deploy.core.stamps import fresh_or_none
from adatracker_deploy.platform import Check, Platform
from adatracker_deploy.runtime.ownership import Claim
from adatracker_drone.adapter.authority import ControlAuthority
from adatracker_drone.adapter.command_client import TICK_NS, CommandClient
from adatracker_drone.adapter.commands import HOLD
from adatracker_drone.adapter.engage import LANDING_MODES, PROOF_OF_LIFE_S, Manoeuvres
from adatracker_drone.adapter.preflight import (
    Parameters,
    envelope_checks,
    failsafe_checks,
    health_checks,
    link_checks,
    mode_checks,
)
from adatracker_drone.adapter.transport import Vehicle
from adatracker_drone.adapter.vehicle_state import Landed, VehicleState
from adatracker_drone.protocol.connection import Connection, altitude_band
from adatracker_drone.protocol.frames import NedPose
from adatracker_drone.protocol.setpoints import body_velocity

if TYPE_CHECKING:
    from collections.abc import Iterable

    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.clock import Clock
    from adatracker_drone.adapter.parameter_changes import Change

_BATTERY_TIMEOUT_S = 10.0
"""An older battery charge is not reported; PX4 sends it five times a second."""
_SAME = 1e-6
"""Share by which a float32 differs from the number that was written."""
_LIFTED_M = 0.2
"""Height below which a drone in take-off is still reported as standing."""


class DroneAdapter(Platform):
    """A PX4 quadrotor behind MAVLink.

    After a takeover (a mode change that this side did not request) neither `hold` nor `disengage` nor `close`
    commands the drone, until an explicit `engage`.
    """

    name = "drone"
    axes = frozenset({"vx", "vy", "vz", "yaw_rate"})
    Connection = Connection
    default_profile = "px4_quad"

    @classmethod
    def identity(cls, profile: Profile) -> str:
        """Name the autopilot's link: the same for every profile that reaches it from this machine."""
        return str(profile.connection.robot)

    def __init__(self, profile: Profile, clock: Clock) -> None:
        super().__init__(profile, clock)
        self._connection: Connection = profile.connection
        self._authority = ControlAuthority(self._connection, clock)
        self._flight: Manoeuvres | None = None
        self._claim: Claim | None = None
        self._turn = threading.Lock()
        self._closing = False

    def connect(self) -> None:
        """Open the connection and wait for the autopilot's HEARTBEAT; moves nothing.

        Raises:
            UsageError: the URL is malformed, its port is taken, or the altitude band does not fit.
            PlatformError: another program on this machine drives it, no autopilot is heard within
                `connect_timeout_s`, it is no PX4, or it is not the one of `uid`.
        """
        with self._turn:
            if self._flight is not None:
                return
            altitude_band(self._connection, self.profile.limits)
            with contextlib.ExitStack() as undo:
                claim = Claim(self._connection.robot)
                undo.callback(claim.close)
                vehicle = Vehicle(self._connection, self.clock, self._authority.on_mode)
                undo.callback(vehicle.close)
                talk = CommandClient(vehicle, self._authority, self.clock)
                self._discover(talk)
                undo.pop_all()
            self._claim = claim
            self._flight = Manoeuvres(
                talk, self._authority, self.clock, self._connection, self.profile.limits
            )

    def _discover(self, talk: CommandClient) -> None:
        """Wait for the autopilot and check its identity."""
        vehicle = talk.vehicle
        wanted, timeout_s = self._connection.uid, self._connection.connect_timeout_s
        deadline_ns = talk.deadline_ns(timeout_s)
        found = False
        while not (found := found or vehicle.discover()) or (wanted and not vehicle.heard.uid):
            now_ns = self.clock.now_ns()
            if self._closing or now_ns > deadline_ns:
                if vehicle.is_px4 is False:
                    raise PlatformError(
                        f"the autopilot on {self._connection.url} is not PX4 (by its HEARTBEAT): "
                        "it is left alone"
                    )
                ignored = f" ({vehicle.ignored})" if vehicle.ignored else ""
                raise PlatformError(
                    f"no autopilot with system id {self._connection.system_id} heard on "
                    f"{self._connection.url} within {timeout_s:g} s{ignored}: "
                    + ("it does not report its uid" if found else "power it, and let it send MAVLink there")
                )
            self.clock.sleep_until(now_ns + TICK_NS)
        if wanted and vehicle.heard.uid != wanted:
            raise PlatformError(
                f"the autopilot on {self._connection.url} has the uid {vehicle.heard.uid}, not {wanted} "
                "(connection: uid): it is another one, and is left alone"
            )

    def preflight(self) -> tuple[Check, ...]:
        """Wait until the drone is ready, at most `ready_timeout_s`; then check it and its fail-safes.

        A drone disarmed in OFFBOARD, as after a fail-safe landing, is put into HOLD first, because it would
        not arm.
        """
        with self._turn:
            flight = self._connected()
            vehicle = flight.vehicle
            timeout_s = self._connection.ready_timeout_s
            left = flight.leave_offboard()
            flight.talk.wait(
                lambda: _is_ready(vehicle.heard) or flight.rests_in_offboard,
                timeout_s,
                self._refuse_when_closing,
            )
            if flight.rests_in_offboard and flight.leave_offboard():  # it may have landed only now
                left = True
                flight.talk.wait(lambda: _is_ready(vehicle.heard), timeout_s, self._refuse_when_closing)
            heard, parameters = vehicle.heard, Parameters.read(vehicle.parameter)
            if parameters.COM_OF_LOSS_T:
                self._authority.loss_s = parameters.COM_OF_LOSS_T
            if parameters.NAV_MC_ALT_RAD is not None:
                flight.acceptance_m = parameters.NAV_MC_ALT_RAD
            return (
                *link_checks(
                    self._connection.url,
                    self._connection.signing_key,
                    vehicle.ignored,
                    blocking=self._connection.alone and vehicle.foreign_datagrams > 0,
                ),
                *mode_checks(
                    heard.mode,
                    armable=heard.armable,
                    left_offboard=left,
                    tells_current_mode=heard.tells_current_mode,
                ),
                *health_checks(
                    unhealthy=heard.unhealthy,
                    armable=heard.armable,
                    complaint=heard.complaint,
                    battery=heard.battery,
                    min_battery=self._connection.min_battery,
                ),
                *failsafe_checks(parameters),
                *envelope_checks(parameters, self.profile.limits),
            )

    def parameters(self) -> Parameters:
        """Return PX4's parameters that a preflight looks at.

        Raises:
            PlatformError: not connected.
        """
        with self._turn:
            return Parameters.read(self._connected().vehicle.parameter)

    def write_parameters(self, changes: Iterable[Change]) -> None:
        """Write parameters and read each back; somebody must have agreed to them.

        Raises:
            PlatformError: the drone is armed, or did not take one; those before it are written.
        """
        with self._turn:
            talk = self._connected().talk
            vehicle = talk.vehicle
            talk.wait(lambda: vehicle.heard.armed_t_ns > 0, self._connection.connect_timeout_s)
            for change in changes:
                if vehicle.heard.armed or not vehicle.heard.armed_t_ns:
                    raise PlatformError(
                        "parameters are not written while the drone is armed: disarm it first"
                    )
                vehicle.set_parameter(change.name, change.value, change.kind)
                found = vehicle.parameter(change.name, change.kind)
                if found is None or abs(found - change.value) > _SAME * max(1.0, abs(change.value)):
                    told = "unknown" if found is None else f"{found:g}"
                    raise PlatformError(
                        f"{change.name} is {told} after {change.value:g} was written: use a ground station"
                    )

    def engage(self) -> None:
        """Arm, climb and switch to OFFBOARD; or, in the air and in HOLD, only switch.

        Raises:
            PlatformError: the autopilot refused a step, the drone is in the air in another mode, or somebody
                called `hold`, `disengage` or `close` meanwhile. One that flies by then is theirs to land.
        """
        with self._turn:
            flight = self._connected()
            if self._authority.engaged:
                return
            self._authority.give_consent()
            proven_ns = flight.talk.deadline_ns(PROOF_OF_LIFE_S)
            try:
                if flight.vehicle.heard.in_air:
                    flight.find_holding()
                else:
                    flight.climb()
                flight.enter_offboard(proven_ns)
            except PlatformError as error:
                self._authority.withdraw(reason=str(error))
                raise

    def send(self, command: Twist, now_ns: int) -> Twist:
        """Send one velocity, with the altitude hold's climb rate added; return what was sent.

        Raises:
            PlatformError: the command is not finite, the drone is not engaged, or it is no longer heard.
        """
        if not command.is_finite():
            raise PlatformError(f"refused to send {command}: not finite")
        return self._authority.steer(self._connected().vehicle, command, now_ns)

    def state(self) -> PlatformState:
        """Return the newest telemetry; the pose is east-north-up, with z from the take-off point."""
        flight = self._flight
        heard = flight.vehicle.heard if flight is not None else VehicleState()
        pose = velocity = None
        if heard.position_ned_m and heard.velocity_ned_m_s and heard.euler_frd_rad:
            north, east, down = heard.position_ned_m
            roll, pitch, heading = heard.euler_frd_rad
            pose = NedPose(north, east, down - self._authority.ground_down_m, roll, pitch, heading).to_enu()
            velocity = body_velocity(heard.velocity_ned_m_s, heading, heard.yaw_rate_frd_rad_s)
        return PlatformState(
            t_ns=max(heard.position_t_ns, heard.attitude_t_ns),
            mode=heard.mode,
            engaged=self._authority.engaged,
            landed=not heard.in_air or self._stands(heard),
            pose=pose,
            velocity=velocity,
            battery=fresh_or_none(heard.battery, heard.battery_t_ns, self.clock, _BATTERY_TIMEOUT_S),
            stopped=self._authority.stopped,
            taken_over=self._authority.taken_over,
        )

    def notices(self) -> tuple[str, ...]:
        """Return notices about ignored messages that did not come from the autopilot."""
        flight = self._flight
        return flight.vehicle.take_notices() if flight is not None else ()

    def hold(self, reason: str) -> None:
        """Command zero once, then HOLD; no set-point follows until an explicit `engage`.

        A drone that is armed and has not left the ground yet is told to land instead.

        Raises:
            PlatformError: HOLD was not acknowledged, or the autopilot does not report who controls the drone.
        """
        self._withdraw(reason)
        with self._turn:
            flight = self._flight
            if flight is None or not self._authority.in_charge:
                return
            if flight.near_ground:
                flight.land()
            else:
                flight.talk.order_down(HOLD, "HOLD")

    def disengage(self) -> None:
        """Land, and return once the drone stands disarmed; at once if it never left the ground.

        Raises:
            PlatformError: LAND was not acknowledged, the autopilot does not report who controls the drone, or
                it did not land and disarm within 60 s.
        """
        self._withdraw()
        with self._turn:
            flight = self._flight
            if flight is None:
                return
            asked_ns = self.clock.now_ns()
            ours = self._authority.in_charge and flight.land()
            heard = flight.vehicle.heard
            if not ours and (not heard.in_air or heard.mode not in LANDING_MODES):
                return
            flight.await_rest(asked_ns, self._refuse_when_closing)
            if self._authority.in_charge:
                flight.leave_offboard()
                self._authority.release()

    def close(self) -> None:
        """Release the connection; a drone that was left flying is told to land first."""
        self._withdraw()
        self._closing = True
        with self._turn:
            flight, self._flight = self._flight, None
            if flight is not None:
                if self._authority.in_charge:
                    with contextlib.suppress(PlatformError):  # the autopilot's fail-safe is the last resort
                        flight.land()
                    self._authority.release()
                flight.vehicle.close()
            if self._claim is not None:
                self._claim.close()
            self._closing = False

    def _withdraw(self, reason: str = "") -> None:
        flight = self._flight
        self._authority.withdraw(flight.vehicle if flight is not None else None, reason)

    def _stands(self, heard: VehicleState) -> bool:
        """Return whether a drone in take-off is still on the ground, with its thrust ramping up."""
        return heard.landed is Landed.TAKING_OFF and self._authority.altitude_m(heard) < _LIFTED_M

    def _connected(self) -> Manoeuvres:
        if self._flight is None:
            raise PlatformError("the drone is not connected: connect first")
        return self._flight

    def _refuse_when_closing(self) -> None:
        if self._closing:
            raise PlatformError("the connection is being closed")


def _is_ready(heard: VehicleState) -> bool:
    heard_of = heard.position_ned_m and heard.euler_frd_rad and heard.landed is not Landed.UNKNOWN
    return bool(heard_of and heard.armable and not heard.unhealthy and heard.battery is not None)
