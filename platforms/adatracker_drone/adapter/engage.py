"""Enable sequence: leads the drone into OFFBOARD and back to the ground; every step checks the authority."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import PlatformError
from adatracker_drone.adapter.commands import ARM, DISARM, HOLD, LAND, OFFBOARD, TAKE_OFF
from adatracker_drone.adapter.vehicle_state import Landed, VehicleState
from adatracker_drone.protocol.connection import Connection, altitude_band

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.config.limits import Limits
    from adatracker_deploy.core.clock import Clock
    from adatracker_drone.adapter.authority import ControlAuthority
    from adatracker_drone.adapter.command_client import CommandClient

PROOF_OF_LIFE_S = 1.2
"""PX4 wants set-points for 1 s before it switches to OFFBOARD."""
LANDING_MODES = ("LAND", "RETURN_TO_LAUNCH")
_SWITCH_TIMEOUT_S = 2.5
"""HEARTBEAT reports a new mode up to 1 s late; one may be lost."""
_SETTLE_S = 0.3
"""A mode received this soon after a command may still be the previous one."""
_REACHED = 0.8
"""The part of the take-off altitude above which a HOLD means that the climb is over."""
_CLIMB_TIMEOUT_S = 30.0
_LANDING_TIMEOUT_S = 60.0
_NEAR_GROUND_M = 0.5
"""Below this height a drone in take-off may still be on the ground, where HOLD could not stop its thrust."""
_DRIFT_M = 0.3
"""Largest drift of the height during a climb."""


class Manoeuvres:
    """The manoeuvres of one vehicle, from one thread at a time.

    Args:
        talk: with the vehicle.
        authority: decides what may be ordered.
        clock: the run's.
        connection: the profile's.
        limits: the profile's.
    """

    acceptance_m = 0.8
    """A take-off ends this far below its altitude (NAV_MC_ALT_RAD)."""

    def __init__(
        self,
        talk: CommandClient,
        authority: ControlAuthority,
        clock: Clock,
        connection: Connection,
        limits: Limits,
    ) -> None:
        self.talk, self.vehicle = talk, talk.vehicle
        self._authority = authority
        self._clock = clock
        self._connection = connection
        self._limits = limits

    def leave_offboard(self) -> bool:
        """Put a drone that stands disarmed in OFFBOARD into HOLD, which moves nothing; say whether it was."""
        vehicle = self.vehicle
        self.talk.hear_mode()
        if not self.rests_in_offboard:
            return False
        vehicle.order(HOLD)
        return self.talk.wait(lambda: vehicle.heard.mode != "OFFBOARD", _SWITCH_TIMEOUT_S)

    def find_holding(self) -> None:
        """Check that a flying drone hovers, without set-points, which would revive a lost OFFBOARD.

        Raises:
            PlatformError: consent was revoked, or it flies in another mode.
        """
        holds = self.talk.wait(
            lambda: self.vehicle.heard.mode == "HOLD", _SWITCH_TIMEOUT_S, self._authority.require_consent
        )
        if not holds:
            raise PlatformError("the drone flies and is not in HOLD: switch it to Hold, or land it, first")

    def climb(self) -> None:
        """Arm and take off; return when the autopilot has ended its take-off by going to HOLD.

        Raises:
            PlatformError: consent was revoked, or the autopilot did not do what it was asked for.
        """
        vehicle, height_m = self.vehicle, self._connection.takeoff_altitude_m
        self.leave_offboard()
        self.talk.demand(
            lambda: _can_arm(vehicle.heard),
            self._connection.ready_timeout_s,
            "the autopilot is not ready to arm: the preflight says why",
        )
        vehicle.set_takeoff_altitude(height_m)  # blocks: nothing has to be stopped yet
        if vehicle.heard.position_ned_m is not None:
            self._authority.ground_down_m = vehicle.heard.position_ned_m[2]
        self._authority.take_charge()
        self._authority.expect(vehicle, vehicle.heard.mode)
        self.talk.order(ARM)
        self._stay_ours()
        self.talk.order(TAKE_OFF, "TAKEOFF", "HOLD")
        settled_ns = self.talk.deadline_ns(_SETTLE_S)
        self.talk.demand(
            lambda: vehicle.heard.mode_t_ns > settled_ns, _SWITCH_TIMEOUT_S, "no mode reported after take-off"
        )
        self._authority.expect(vehicle, "TAKEOFF", "HOLD")
        self.talk.demand(
            lambda: vehicle.heard.mode == "HOLD",
            _CLIMB_TIMEOUT_S,
            f"the drone did not climb to {height_m:g} m",
        )
        ends_m = height_m - min(self.acceptance_m, height_m / 2) - _DRIFT_M
        if self._authority.altitude_m(vehicle.heard) < ends_m:
            self._authority.lose("the drone went to HOLD before its take-off was over: by its pilot")
        self.talk.demand(
            lambda: self._authority.altitude_m(vehicle.heard) > _REACHED * height_m,
            _CLIMB_TIMEOUT_S,
            f"the drone did not climb to {height_m:g} m and hold there",
        )

    def enter_offboard(self, proven_ns: int) -> None:
        """Switch from HOLD, and only from HOLD: a take-off that ends would undo an earlier switch.

        Args:
            proven_ns: when set-points will have gone out for long enough.

        Raises:
            PlatformError: consent was revoked, or the autopilot does not go to OFFBOARD.
        """
        vehicle = self.vehicle
        self._authority.expect(vehicle, "HOLD")
        self.talk.wait(lambda: self._clock.now_ns() >= proven_ns, PROOF_OF_LIFE_S, self.talk.keep_alive)
        self._authority.take_charge()
        self._stay_ours()
        self._authority.hold_altitude(vehicle, altitude_band(self._connection, self._limits))
        for _ in range(2):
            self.talk.order(OFFBOARD, "OFFBOARD")
            if self.talk.wait(
                lambda: vehicle.heard.mode == "OFFBOARD", _SWITCH_TIMEOUT_S, self.talk.keep_alive
            ):
                self._authority.engage(vehicle)
                return
        why = vehicle.heard.complaint or "it gave no reason"
        raise PlatformError(f"the autopilot did not go to OFFBOARD: {why}")

    def land(self) -> bool:
        """Command LAND, and on the ground also disarm; return whether this side was still in charge.

        Raises:
            PlatformError: LAND was not acknowledged, or the autopilot does not report who controls the drone.
        """
        if not self.talk.order_down(LAND, "LAND", "HOLD"):
            return False
        if self.vehicle.heard.on_ground:
            self._authority.order_down(
                self.vehicle, DISARM
            )  # refused while the thrust ramps up: then LAND does it
        return True

    def await_rest(self, asked_ns: int, unless_closing: Callable[[], None]) -> None:
        """Wait until a landing drone stands disarmed, or somebody else has taken it over.

        Args:
            asked_ns: when that was asked for; what was heard before does not count.
            unless_closing: called again and again; ends the wait by raising.

        Raises:
            PlatformError: it does not come to rest within 60 s.
        """
        heard = self.vehicle.heard
        settled_ns = self.talk.deadline_ns(_SWITCH_TIMEOUT_S)

        def over() -> bool:
            nonlocal heard
            heard = self.vehicle.heard
            stands = heard.armed_t_ns > asked_ns and not heard.armed and heard.on_ground
            return stands or self._gone(heard, settled_ns)

        if not self.talk.wait(over, _LANDING_TIMEOUT_S, unless_closing):
            raise PlatformError(
                f"not landed and disarmed {_LANDING_TIMEOUT_S:g} s after LAND: "
                "take over with the remote control, land and disarm by hand"
            )
        if self._gone(heard, settled_ns):
            self._authority.lose(f"the drone went to {heard.mode} while it landed: by its pilot")

    def _stay_ours(self) -> None:
        """Ask for the mode before a command that changes it, which would take the drone from its pilot.

        Raises:
            PlatformError: consent was revoked, as by a pilot's mode, or the autopilot does not answer.
        """
        if not self.talk.is_ours():
            self._authority.require_consent()

    @staticmethod
    def _gone(heard: VehicleState, settled_ns: int) -> bool:
        """Return whether a landing drone flies on in another mode."""
        flies = heard.armed and heard.in_air and heard.mode_t_ns > settled_ns
        return flies and heard.mode not in LANDING_MODES

    @property
    def rests_in_offboard(self) -> bool:
        """Whether the drone stands disarmed in a mode in which PX4 does not arm."""
        heard = self.vehicle.heard
        return heard.mode == "OFFBOARD" and not (heard.armed or heard.in_air)

    @property
    def near_ground(self) -> bool:
        """Whether the drone may still stand on the ground, whatever its thrust does."""
        heard = self.vehicle.heard
        low = heard.landed is Landed.TAKING_OFF and self._authority.altitude_m(heard) < _NEAR_GROUND_M
        return heard.on_ground or low


def _can_arm(heard: VehicleState) -> bool:
    return heard.armable and heard.on_ground and heard.position_ned_m is not None
