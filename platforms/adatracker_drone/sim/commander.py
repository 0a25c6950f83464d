"""PX4's Commander: arming, mode requests, the offboard rules, the fail-safe.

Time is the vehicle's, in seconds since power-on. Loss times are wall seconds, as in PX4's simulator: at five
times real time COM_OF_LOSS_T lasts five times as long in simulated time.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

from adatracker_drone.protocol.px4 import (
    LOSS_ACTIONS,
    NEEDS_STICKS,
    TRANSIENT,
    Landed,
    Mode,
    Result,
    Severity,
)
from adatracker_drone.sim.motion import Motion
from adatracker_drone.sim.parameters import Parameters

FORCE = 21196
"""The number that makes an arm or disarm command unconditional (MAV_CMD_COMPONENT_ARM_DISARM)."""

_STREAM_S = 1.0
"""PX4's manual asks for a second of set-points before the switch to OFFBOARD..."""
_STREAM_GAP_S = 0.5
"""...at 2 Hz or more."""
_TAKEOFF_SETTLE_S = 1.0
"""From reaching the takeoff altitude until the navigator reports the takeoff finished."""
_STILL_M_S = 0.2
_LOW_BATTERY = 0.15
"""COM_LOW_BAT: below it arming is refused (BAT_LOW_THR)."""
_STATUS_S = 0.5
"""`vehicle_status` is published so often while nothing changes, and at once when something does."""


class Said(NamedTuple):
    """A message for people: a text, and an event by its name."""

    severity: Severity
    text: str
    event: str
    """Empty where PX4 has none that matters here."""


@dataclass(slots=True)
class _Offboard:
    """The stream of set-points and the request to follow it."""

    last_s: float = -math.inf
    since_s: float = math.inf
    """Start of the present stream without a gap."""
    engaged: bool = False
    """The mode has been reached since it was asked for: a stream that returns after a loss resumes it."""


class Commander:
    """Arming state and flight mode of one vehicle."""

    def __init__(
        self, parameters: Parameters, *, ekf_ready_s: float, landing_detected_s: float, speed: float
    ) -> None:
        self._parameters = parameters
        self._ekf_ready_s = ekf_ready_s
        self._landing_detected_s = landing_detected_s
        self._speed = speed
        self.armed = False
        self.mode = Mode.HOLD
        """The mode that flies now."""
        self.failsafe = False
        """Whether the fail-safe, not the user, chose the mode."""
        self.landed = True
        """The land detector's state: False from the moment the thrust ramps up, still on the ground."""
        self.lifts = False
        """The ramp is over: the motors follow the demand."""
        self.said: deque[Said] = deque(maxlen=32)
        """For STATUSTEXT and EVENT; the sender takes them out."""
        self.takeoff_altitude_m = parameters["MIS_TAKEOFF_ALT"]
        """Above home."""
        self.home_m = 0.0
        """The height that was believed when the vehicle was armed; home is set then (COM_HOME_EN)."""
        self.battery = 1.0
        """State of charge, 0 to 1; set by the owner."""
        self.published_s = 0.0
        """Time of the last publication of `vehicle_status`."""
        self._published: tuple[Mode, Mode, bool, bool] | None = None
        self.wanted = Mode.HOLD
        """The mode that was asked for last: the user's intention."""
        self._after_disarming = Mode.HOLD
        self._offboard = _Offboard()
        self._armed_s = 0.0
        self._ramp_s: float | None = None
        self._flown = False
        self._landed_s = 0.0
        self._still_since_s = 0.0
        self._reached_s: float | None = None
        """Time at which a takeoff reached its altitude; None once it is reported finished."""

    def ready(self, now_s: float) -> bool:
        """Return whether the arming checks of the present mode pass."""
        if self.armed:
            return self.battery > _LOW_BATTERY
        return not self._arming_obstacle(now_s)

    @property
    def landed_state(self) -> Landed:
        """The state that EXTENDED_SYS_STATE reports."""
        if self.landed:
            return Landed.ON_GROUND
        special = {Mode.TAKEOFF: Landed.TAKING_OFF, Mode.LAND: Landed.LANDING}
        return special.get(self.mode, Landed.IN_AIR)

    def heard_set_point(self, now_s: float) -> None:
        """Count a valid offboard set-point as proof of life."""
        if now_s - self._offboard.last_s > _STREAM_GAP_S * self._speed:
            self._offboard.since_s = now_s
        self._offboard.last_s = now_s

    def arm(self, now_s: float, *, force: bool) -> Result:
        """Start the motors."""
        if self.armed:
            return Result.ACCEPTED
        why, event = self._arming_obstacle(now_s) or ("", "")
        if why and not force:
            self._say(Severity.CRITICAL, why, event)
            self._say(
                Severity.CRITICAL, f"Arming denied: {why}"[:50], "commander_arm_denied_resolve_failures"
            )
            return Result.REFUSED_NOW
        self.armed, self._armed_s, self._flown = True, now_s, False
        self._say(Severity.INFO, "Armed by external command")
        return Result.ACCEPTED

    def disarm(self, *, force: bool) -> Result:
        """Stop the motors: in the air only by force, and then the vehicle falls."""
        if not self.armed:
            return Result.ACCEPTED
        if not (self.landed or force):
            self._say(Severity.CRITICAL, "Disarming denied: not landed", "commander_disarm_denied_not_landed")
            return Result.REFUSED_NOW
        self._disarm("Disarmed by external command")
        return Result.ACCEPTED

    def request(self, mode: Mode, now_s: float) -> Result:
        """Ask for a mode; while disarmed any is granted, as in PX4."""
        refused = self.armed and mode in NEEDS_STICKS and mode is not Mode.POSCTL
        if refused or (self.armed and mode is Mode.OFFBOARD and self._lost(now_s)):
            event = "check_modes_manual_control" if refused else "check_modes_offboard_signal"
            self._say(Severity.CRITICAL, f"Switching to {mode.name} is currently not available", event)
            return Result.REFUSED_NOW
        self.wanted = mode
        if mode not in TRANSIENT:
            self._after_disarming = mode
        self._offboard.engaged = False
        if mode is not Mode.OFFBOARD or not self.armed:
            self._switch(mode)
        return Result.ACCEPTED

    def takeoff(self, altitude_m: float, now_s: float) -> Result:
        """Climb to a height above home; NaN takes MIS_TAKEOFF_ALT."""
        wanted = altitude_m if math.isfinite(altitude_m) else self._parameters["MIS_TAKEOFF_ALT"]
        self.takeoff_altitude_m = min(max(wanted, 0.5), 120.0)
        return self.request(Mode.TAKEOFF, now_s)

    def update(self, truth: Motion, estimate: Motion, now_s: float, *, climbs: bool) -> None:
        """Let time pass: landing detection, the end of a takeoff, fences, the offboard rules, auto-disarm.

        Args:
            truth: how it moves; a land detector feels thrust and touch, not the estimate's error.
            estimate: how it believes to move.
            now_s: since power-on.
            climbs: whether what is flown now asks for a climb.
        """
        if self.armed:
            self._ramp_up(now_s, climbs=climbs)
        else:
            self.home_m = estimate.altitude
        self._detect_landing(truth, now_s)
        if self.armed:
            self._finish_takeoff(estimate, now_s)
            self._fence(estimate, now_s)
            if self.wanted is Mode.OFFBOARD:
                self._judge_stream(now_s)
            self._disarm_when_idle(now_s)
        status = self.mode, self.wanted, self.armed, self.failsafe
        if status != self._published or now_s - self.published_s >= _STATUS_S:
            self._published, self.published_s = status, now_s

    def _arming_obstacle(self, now_s: float) -> tuple[str, str] | None:
        """Return why it cannot be armed, as a text and as the name of an event."""
        waits = "Navigation error: No valid position estimate"
        obstacles = (
            (now_s < self._ekf_ready_s, waits, "check_modes_local_pos"),
            (self.battery <= _LOW_BATTERY, "Low battery", ""),
            (not self.landed, "not landed", ""),
            (self.wanted in NEEDS_STICKS, "No manual control input", "check_modes_manual_control"),
            (
                self.wanted is Mode.OFFBOARD and self._lost(now_s),
                "No offboard signal",
                "check_modes_offboard_signal",
            ),
            (
                self.wanted in (Mode.LAND, Mode.RTL),
                "Mode not suitable for arming",
                "check_modes_cannot_takeoff",
            ),
        )
        return next(((why, event) for stands, why, event in obstacles if stands), None)

    def _disarm(self, why: str) -> None:
        self.armed, self.lifts, self._ramp_s = False, False, None
        self.wanted = self._after_disarming
        self._offboard.engaged = False
        self._switch(self.wanted)
        self._say(Severity.INFO, why)

    def _switch(self, mode: Mode, *, failsafe: bool = False) -> None:
        self.failsafe = failsafe
        if mode is not Mode.OFFBOARD:
            self._reached_s = None
        self.mode = mode

    def _lost(self, now_s: float) -> bool:
        return now_s - self._offboard.last_s > self._parameters["COM_OF_LOSS_T"] * self._speed

    def _judge_stream(self, now_s: float) -> None:
        """Follow the stream, wait for it to prove itself, or act on its loss."""
        stream = self._offboard
        if self._lost(now_s):
            if not stream.engaged:
                self.wanted = self.mode  # the request lapses before it took effect
            elif not self.failsafe:
                self._act_on_loss()
            return
        flows = now_s - stream.last_s <= _STREAM_GAP_S * self._speed
        proven = stream.engaged or (flows and now_s - stream.since_s >= _STREAM_S * self._speed)
        if proven and (self.mode is not Mode.OFFBOARD or not stream.engaged):
            stream.engaged = True
            self._switch(Mode.OFFBOARD)

    def _act_on_loss(self) -> None:
        action = LOSS_ACTIONS[int(self._parameters["COM_OBL_RC_ACT"])]
        name = action.name if action else "motors off"
        self._say(
            Severity.CRITICAL,
            f"Failsafe activated: offboard signal lost, {name}",
            "commander_failsafe_enter_generic",
        )
        if action is None:
            self._disarm("Disarmed by failsafe")
        else:
            self._switch(action, failsafe=True)

    def _finish_takeoff(self, estimate: Motion, now_s: float) -> None:
        """Report a takeoff finished, which switches to HOLD even if OFFBOARD took over in the meantime."""
        if self.mode is Mode.TAKEOFF and self._reached_s is None:
            below = self.home_m + self.takeoff_altitude_m - estimate.altitude
            if below <= min(self._parameters["NAV_MC_ALT_RAD"], self.takeoff_altitude_m / 2):
                self._reached_s = now_s
        if self._reached_s is not None and now_s - self._reached_s >= _TAKEOFF_SETTLE_S:
            self.wanted = self._after_disarming = Mode.HOLD
            self._offboard.engaged = False
            self._switch(Mode.HOLD)

    def _fence(self, estimate: Motion, now_s: float) -> None:
        """Hold at the geofence, where one is set (GF_ACTION 2; 3 returns)."""
        action = {2: Mode.HOLD, 3: Mode.RTL, 5: Mode.LAND}.get(int(self._parameters["GF_ACTION"]))
        across, up = self._parameters["GF_MAX_HOR_DIST"], self._parameters["GF_MAX_VER_DIST"]
        out = (
            0 < across < math.hypot(estimate.north, estimate.east) or 0 < up < estimate.altitude - self.home_m
        )
        if out and action and self.wanted not in (action, Mode.LAND, Mode.RTL):
            self._say(Severity.CRITICAL, f"Geofence violated, {action.name}")
            self.request(action, now_s)

    def _ramp_up(self, now_s: float, *, climbs: bool) -> None:
        """Spool up, then let the thrust ramp up while something asks an armed vehicle to climb."""
        if self.lifts or now_s - self._armed_s < self._parameters["COM_SPOOLUP_TIME"]:
            return
        if not climbs:
            self._ramp_s = None
        elif self._ramp_s is None:
            self._ramp_s = now_s
            self.landed, self._flown = False, True
            self._say(Severity.INFO, "Takeoff detected")
        elif now_s - self._ramp_s >= self._parameters["MPC_TKO_RAMP_T"]:
            self.lifts = True

    def _detect_landing(self, truth: Motion, now_s: float) -> None:
        if self._ramp_s is not None and not self.lifts:
            self._still_since_s = now_s
        if not truth.on_gear or abs(truth.v_down) > _STILL_M_S:
            self._still_since_s = now_s
        if not self.landed and now_s - self._still_since_s >= self._landing_detected_s:
            self.landed, self._landed_s, self.lifts, self._ramp_s = True, now_s, False, None
            self._say(Severity.INFO, "Landing detected")

    def _disarm_when_idle(self, now_s: float) -> None:
        if not self.landed or self.mode is Mode.TAKEOFF:
            return
        since_s = self._landed_s if self._flown else self._armed_s
        name = "COM_DISARM_LAND" if self._flown else "COM_DISARM_PRFLT"
        if 0 < self._parameters[name] <= now_s - since_s:
            self._disarm("Disarmed by landing" if self._flown else "Disarmed by auto preflight disarming")

    def _say(self, severity: Severity, text: str, event: str = "") -> None:
        self.said.append(Said(severity, text[:50], event))
