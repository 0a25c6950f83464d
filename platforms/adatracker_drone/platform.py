"""The drone's adapter: a PX4 quadrotor flown by body velocities in OFFBOARD.

What blocks (connecting, climbing, landing) takes turns behind one lock. What must not wait (a stop, a
set-point, a takeover) goes through the `Helm`, so that a stop from another thread ends an engage at once.
"""

from __future__ import annotations

import contextlib
import threading
from typing import TYPE_CHECKING

from adatracker_deploy.errors import PlatformError
from adatracker_deploy.platform import Body, Check, Platform, PlatformState, Sitl, Twist
from adatracker_drone.connection import Connection, altitude_band
from adatracker_drone.frames import NedPose
from adatracker_drone.helm import Helm
from adatracker_drone.preflight import (
    Parameters,
    envelope_checks,
    failsafe_checks,
    health_checks,
    link_checks,
)
from adatracker_drone.protocol import body_velocity
from adatracker_drone.settings import SitlSettings
from adatracker_drone.vehicle import Heard, Vehicle

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.profile import Profile
    from adatracker_deploy.runtime.clock import Clock

_TICK_NS = 50_000_000
"""Set-points while engaging: 20 Hz, where PX4 wants more than 2 Hz."""
_PROOF_OF_LIFE_S = 1.2
"""PX4 wants set-points for 1 s before it switches to OFFBOARD."""
_SWITCH_TIMEOUT_S = 2.5
"""HEARTBEAT tells of a new mode up to 1 s late; one may be lost on the way."""
_SETTLE_S = 0.3
"""A HEARTBEAT so soon after an acknowledged command may still tell the mode before it."""
_REACHED = 0.8
"""The part of the take-off altitude above which a HOLD means that the climb is over."""
_CLIMB_TIMEOUT_S = 30.0
_LANDING_TIMEOUT_S = 60.0
_LANDING_MODES = ("LAND", "RETURN_TO_LAUNCH")


class DronePlatform(Platform):
    """A PX4 quadrotor behind MAVLink.

    After a takeover (a mode that nobody here asked for) the drone is whoever's took it: neither `hold` nor
    `disengage` nor `close` commands it again, until an explicit `engage`.
    """

    name = "drone"
    axes = frozenset({"vx", "vy", "vz", "yaw_rate"})
    Connection = Connection
    SitlSettings = SitlSettings
    default_profile = "px4_quad"

    def __init__(self, profile: Profile, clock: Clock) -> None:
        super().__init__(profile, clock)
        self._connection: Connection = profile.connection
        self._helm = Helm(self._connection, clock)
        self._vehicle: Vehicle | None = None
        self._turn = threading.Lock()
        self._closing = False

    def connect(self) -> None:
        """Open the connection and wait for the autopilot's HEARTBEAT; moves nothing.

        Raises:
            UsageError: the URL is malformed, its port is taken, or the altitude band does not fit.
            PlatformError: no autopilot is heard within `connect_timeout_s`.
        """
        with self._turn:
            if self._vehicle is not None:
                return
            altitude_band(self._connection, self.profile.limits)
            vehicle = Vehicle(self._connection, self.clock, self._helm.on_mode)
            deadline_ns = self._deadline_ns(self._connection.connect_timeout_s)
            while not vehicle.discover():
                now_ns = self.clock.now_ns()
                if self._closing or now_ns > deadline_ns:
                    ignored = f" ({vehicle.ignored})" if vehicle.ignored else ""
                    vehicle.close()
                    raise PlatformError(
                        f"no autopilot with system id {self._connection.system_id} heard on "
                        f"{self._connection.url} within {self._connection.connect_timeout_s:g} s{ignored}: "
                        "power it, and let it send MAVLink there"
                    )
                self.clock.sleep_until(now_ns + _TICK_NS)
            self._vehicle = vehicle

    def preflight(self) -> tuple[Check, ...]:
        """Wait until the drone is ready, `ready_timeout_s` at most; then judge it and its fail-safes."""
        with self._turn:
            vehicle = self._connected()
            self._wait(vehicle, _is_ready, self._connection.ready_timeout_s, self._refuse_when_closing)
            heard, parameters = vehicle.heard, Parameters.read(vehicle.parameter)
            return (
                *link_checks(self._connection.url, self._connection.signing_key, vehicle.ignored),
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

    def engage(self) -> None:
        """Arm, climb and switch to OFFBOARD; or, in the air and in HOLD, only switch.

        Raises:
            PlatformError: the autopilot refused a step, the drone is in the air in another mode, or somebody
                called `hold`, `disengage` or `close` meanwhile. One that flies by then is theirs to land.
        """
        with self._turn:
            vehicle = self._connected()
            if self._helm.engaged:
                return
            self._helm.give_consent()
            proven_ns = self._deadline_ns(_PROOF_OF_LIFE_S)
            try:
                if vehicle.heard.landed is False:
                    self._find_holding(vehicle)
                else:
                    self._climb(vehicle)
                self._enter_offboard(vehicle, proven_ns)
            except PlatformError as error:
                self._helm.withdraw(reason=str(error))
                raise

    def send(self, command: Twist, now_ns: int) -> Twist:
        """Send one velocity, with the altitude hold's climb rate added; return what was sent.

        Raises:
            PlatformError: the command is not finite, the drone is not engaged, or it is no longer heard.
        """
        if not command.is_finite():
            raise PlatformError(f"refused to send {command}: not finite")
        return self._helm.steer(self._connected(), command, now_ns)

    def state(self) -> PlatformState:
        """Return what telemetry said last; the pose is east-north-up, its z from where the drone took off."""
        vehicle = self._vehicle
        heard = vehicle.heard if vehicle is not None else Heard()
        pose = velocity = None
        if heard.position_ned_m and heard.velocity_ned_m_s and heard.euler_frd_rad:
            north, east, down = heard.position_ned_m
            roll, pitch, heading = heard.euler_frd_rad
            pose = NedPose(north, east, down - self._helm.ground_down_m, roll, pitch, heading).to_enu()
            velocity = body_velocity(heard.velocity_ned_m_s, heading, heard.yaw_rate_frd_rad_s)
        return PlatformState(
            t_ns=max(heard.position_t_ns, heard.attitude_t_ns),
            mode=heard.mode,
            engaged=self._helm.engaged,
            landed=heard.landed is not False,
            pose=pose,
            velocity=velocity,
            battery=heard.battery,
            stopped=self._helm.stopped,
            taken_over=self._helm.taken_over,
        )

    def notices(self) -> tuple[str, ...]:
        """Return what the link ignored because it did not come from the autopilot."""
        vehicle = self._vehicle
        return vehicle.take_notices() if vehicle is not None else ()

    def hold(self, reason: str) -> None:
        """Command zero once, then HOLD; no set-point follows until an explicit `engage`."""
        self._helm.withdraw(self._vehicle, reason)
        with self._turn:
            if self._vehicle is not None and self._helm.in_charge:
                self._vehicle.hold()

    def disengage(self) -> None:
        """Land, and return once the drone stands disarmed; at once if it never left the ground.

        Raises:
            PlatformError: LAND was not acknowledged, or the drone did not land and disarm within 60 s.
        """
        self._helm.withdraw(self._vehicle)
        with self._turn:
            vehicle = self._vehicle
            if vehicle is None:
                return
            asked_ns = self.clock.now_ns()
            if self._helm.in_charge:
                vehicle.land()
            elif vehicle.heard.landed is not False or vehicle.heard.mode not in _LANDING_MODES:
                return

            def down(heard: Heard) -> bool:
                return heard.armed_t_ns > asked_ns and not heard.armed and heard.landed is True

            if not self._wait(vehicle, down, _LANDING_TIMEOUT_S, self._refuse_when_closing):
                raise PlatformError(
                    f"not landed and disarmed {_LANDING_TIMEOUT_S:g} s after LAND: "
                    "take over with the remote control, land and disarm by hand"
                )
            self._helm.in_charge = False

    def close(self) -> None:
        """Release the connection; a drone that was left flying is told to land first."""
        self._helm.withdraw(self._vehicle)
        self._closing = True
        with self._turn:
            vehicle, self._vehicle = self._vehicle, None
            if vehicle is not None:
                if self._helm.in_charge:
                    with contextlib.suppress(PlatformError):  # the autopilot's fail-safe is the last resort
                        vehicle.land()
                    self._helm.in_charge = False
                vehicle.close()
            self._closing = False

    @classmethod
    def body(cls, profile: Profile) -> Body:
        """Return the quadrotor's dynamics; needs the sitl extra."""
        from adatracker_drone.body import DroneBody

        return DroneBody(profile.sitl)

    @classmethod
    def sitl(cls, profile: Profile) -> Sitl:
        """Return a simulated PX4 vehicle in a process of its own; needs the sitl extra."""
        from adatracker_drone.sitl import DroneSitl

        return DroneSitl(profile)

    def _find_holding(self, vehicle: Vehicle) -> None:
        """Make sure that a flying drone hovers; silently: set-points would revive a lost OFFBOARD."""
        if not self._wait(
            vehicle, lambda heard: heard.mode == "HOLD", _SWITCH_TIMEOUT_S, self._helm.require_consent
        ):
            raise PlatformError("the drone flies and is not in HOLD: switch it to Hold, or land it, first")

    def _climb(self, vehicle: Vehicle) -> None:
        """Arm and take off; return when the autopilot has ended its take-off by going to HOLD."""
        self._demand(
            vehicle,
            lambda heard: heard.armable and heard.landed is True and heard.position_ned_m is not None,
            self._connection.ready_timeout_s,
            "the autopilot is not ready to arm: the preflight says why",
        )
        if vehicle.heard.position_ned_m is not None:
            self._helm.ground_down_m = vehicle.heard.position_ned_m[2]
        self._helm.take_charge()
        vehicle.arm()
        self._helm.keep_alive(vehicle)
        vehicle.take_off(self._connection.takeoff_altitude_m)
        settled_ns = self._deadline_ns(_SETTLE_S)
        self._demand(
            vehicle,
            lambda heard: heard.mode_t_ns > settled_ns,
            _SWITCH_TIMEOUT_S,
            "no HEARTBEAT after take-off",
        )
        self._helm.expect(vehicle, "TAKEOFF", "HOLD")
        reached_m = _REACHED * self._connection.takeoff_altitude_m
        self._demand(
            vehicle,
            lambda heard: heard.mode == "HOLD" and self._helm.altitude_m(heard) > reached_m,
            _CLIMB_TIMEOUT_S,
            f"the drone did not climb to {self._connection.takeoff_altitude_m:g} m and hold there",
        )

    def _enter_offboard(self, vehicle: Vehicle, proven_ns: int) -> None:
        """Switch from HOLD, and only from HOLD: a take-off that ends would undo an earlier switch.

        Args:
            vehicle: in HOLD, in the air.
            proven_ns: when set-points will have gone out for long enough.
        """
        self._helm.expect(vehicle, "HOLD", "OFFBOARD")
        while self.clock.now_ns() < proven_ns:
            self._helm.keep_alive(vehicle)
            self.clock.sleep_until(self.clock.now_ns() + _TICK_NS)
        self._helm.take_charge()
        self._helm.hold_altitude(vehicle, altitude_band(self._connection, self.profile.limits))
        for _ in range(2):
            vehicle.switch_to_offboard()
            if self._wait(
                vehicle,
                lambda heard: heard.mode == "OFFBOARD",
                _SWITCH_TIMEOUT_S,
                lambda: self._helm.keep_alive(vehicle),
            ):
                self._helm.engage(vehicle)
                return
        why = vehicle.heard.complaint or "it gave no reason"
        raise PlatformError(f"the autopilot did not go to OFFBOARD: {why}")

    def _connected(self) -> Vehicle:
        if self._vehicle is None:
            raise PlatformError("the drone is not connected: connect first")
        return self._vehicle

    def _refuse_when_closing(self) -> None:
        if self._closing:
            raise PlatformError("the connection is being closed")

    def _demand(
        self, vehicle: Vehicle, condition: Callable[[Heard], bool], timeout_s: float, failure: str
    ) -> None:
        """Wait while there is consent, with set-points going out; fail when `condition` is not met."""
        if not self._wait(vehicle, condition, timeout_s, lambda: self._helm.keep_alive(vehicle)):
            raise PlatformError(failure)

    def _wait(
        self,
        vehicle: Vehicle,
        condition: Callable[[Heard], bool],
        timeout_s: float,
        meanwhile: Callable[[], None],
    ) -> bool:
        """Do something at 20 Hz until telemetry meets `condition`; return whether it did in time."""
        deadline_ns = self._deadline_ns(timeout_s)
        while not condition(vehicle.heard):
            meanwhile()
            now_ns = self.clock.now_ns()
            if now_ns > deadline_ns:
                return False
            self.clock.sleep_until(now_ns + _TICK_NS)
        return True

    def _deadline_ns(self, timeout_s: float) -> int:
        """Count in the machine's time: MAVSDK and the radio run no faster in a fast rehearsal."""
        return self.clock.now_ns() + round(timeout_s * self.clock.speed * 1e9)


def _is_ready(heard: Heard) -> bool:
    heard_of = heard.position_ned_m and heard.euler_frd_rad and heard.landed is not None
    return bool(heard_of and heard.armable and not heard.unhealthy and heard.battery is not None)
