"""Who may fly, and in which mode: arming, mode requests, the offboard rules, the fail-safe. PX4's Commander.

Time is the vehicle's, in seconds since power-on. Loss times are wall seconds, as in PX4's simulator: at five
times real time COM_OF_LOSS_T lasts five times as long in simulated time.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from adatracker_drone.motion import Motion
from adatracker_drone.parameters import Parameters
from adatracker_drone.px4 import LOSS_ACTIONS, Landed, Mode, Result, Severity

FORCE = 21196
"""The number that makes an arm or disarm command unconditional (MAV_CMD_COMPONENT_ARM_DISARM)."""

_STREAM_S = 1.0
"""PX4's manual asks for a second of set-points before the switch to OFFBOARD..."""
_STREAM_GAP_S = 0.5
"""...at 2 Hz or more."""
_TAKEOFF_SETTLE_S = 0.5
"""From reaching the takeoff altitude until the navigator reports the takeoff finished."""
_LANDED_S = 0.8
"""Standing still for so long counts as landed (land_detector)."""
_STILL_M_S = 0.2
_LOW_BATTERY = 0.15
"""COM_LOW_BAT: below it arming is refused (BAT_LOW_THR)."""

_NEEDS_STICKS = {Mode.MANUAL}


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

    def __init__(self, parameters: Parameters, *, ekf_ready_s: float, speed: float) -> None:
        self._parameters = parameters
        self._ekf_ready_s = ekf_ready_s
        self._speed = speed
        self.armed = False
        self.mode = Mode.HOLD
        """The mode that flies now."""
        self.failsafe = False
        """The fail-safe, not the user, chose the mode."""
        self.landed = True
        self.texts: deque[tuple[Severity, str]] = deque(maxlen=32)
        """For STATUSTEXT; whoever sends them takes them out."""
        self.takeoff_altitude_m = parameters["MIS_TAKEOFF_ALT"]
        self.battery = 1.0
        """State of charge, 0 to 1; set by the owner."""
        self._wanted = Mode.HOLD
        self._offboard = _Offboard()
        self._armed_s = 0.0
        self._flown = False
        self._landed_s = 0.0
        self._still_since_s = 0.0
        self._reached_s: float | None = None
        """When a takeoff reached its altitude and has not been reported finished."""

    def ready(self, now_s: float) -> bool:
        """Tell whether the arming checks pass."""
        return now_s >= self._ekf_ready_s and self.battery > _LOW_BATTERY

    def may_lift(self, now_s: float) -> bool:
        """Tell whether the motors have spooled up since arming."""
        return self.armed and now_s - self._armed_s >= self._parameters["COM_SPOOLUP_TIME"]

    @property
    def landed_state(self) -> Landed:
        """What EXTENDED_SYS_STATE says."""
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
        why = self._arming_obstacle(now_s)
        if why and not force:
            self._say(Severity.CRITICAL, f"Arming denied: {why}")
            return Result.REFUSED_NOW
        self.armed, self._armed_s, self._flown = True, now_s, False
        self._say(Severity.INFO, "Armed by external command")
        return Result.ACCEPTED

    def disarm(self, *, force: bool) -> Result:
        """Stop the motors: in the air only by force, and then the vehicle falls."""
        if not self.armed:
            return Result.ACCEPTED
        if not (self.landed or force):
            self._say(Severity.CRITICAL, "Disarming denied: not landed")
            return Result.REFUSED_NOW
        self._disarm("Disarmed by external command")
        return Result.ACCEPTED

    def request(self, mode: Mode, now_s: float) -> Result:
        """Ask for a mode; while disarmed any is granted, as in PX4."""
        if self.armed and mode in _NEEDS_STICKS:
            self._say(Severity.CRITICAL, f"Switching to {mode.name} denied: no manual control")
            return Result.REFUSED_NOW
        if self.armed and mode is Mode.OFFBOARD and self._lost(now_s):
            self._say(Severity.CRITICAL, "Switching to OFFBOARD denied: no set-points")
            return Result.REFUSED_NOW
        self._wanted = mode
        self._offboard.engaged = False
        if mode is not Mode.OFFBOARD or not self.armed:
            self._switch(mode)
        return Result.ACCEPTED

    def takeoff(self, altitude_m: float, now_s: float) -> Result:
        """Climb to a height above home; NaN takes MIS_TAKEOFF_ALT."""
        wanted = altitude_m if math.isfinite(altitude_m) else self._parameters["MIS_TAKEOFF_ALT"]
        self.takeoff_altitude_m = min(max(wanted, 0.5), 120.0)
        return self.request(Mode.TAKEOFF, now_s)

    def update(self, motion: Motion, now_s: float) -> None:
        """Let time pass: landing detection, the end of a takeoff, fences, the offboard rules, auto-disarm."""
        self._detect_landing(motion, now_s)
        if not self.armed:
            return
        self._finish_takeoff(motion, now_s)
        self._fence(motion, now_s)
        if self._wanted is Mode.OFFBOARD:
            self._judge_stream(now_s)
        self._disarm_when_idle(now_s)

    def _arming_obstacle(self, now_s: float) -> str:
        obstacles = (
            (now_s < self._ekf_ready_s, "system is not ready, waiting for the position estimate"),
            (self.battery <= _LOW_BATTERY, "low battery"),
            (not self.landed, "not landed"),
            (self._wanted in _NEEDS_STICKS or self._wanted is Mode.POSCTL, "no manual control"),
            (self._wanted is Mode.OFFBOARD and self._lost(now_s), "no offboard set-points"),
            (self._wanted in (Mode.LAND, Mode.RTL), f"mode {self._wanted.name} is not for takeoff"),
        )
        return next((why for stands, why in obstacles if stands), "")

    def _disarm(self, why: str) -> None:
        self.armed = False
        self._wanted = Mode.HOLD
        self._offboard.engaged = False
        self._switch(Mode.HOLD)
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
                self._wanted = self.mode  # the request lapses before it took effect
            elif not self.failsafe:
                action = LOSS_ACTIONS[int(self._parameters["COM_OBL_RC_ACT"])]
                self._say(Severity.CRITICAL, f"Failsafe activated: offboard signal lost, {action.name}")
                self._switch(action, failsafe=True)
            return
        flows = now_s - stream.last_s <= _STREAM_GAP_S * self._speed
        proven = stream.engaged or (flows and now_s - stream.since_s >= _STREAM_S * self._speed)
        if proven and (self.mode is not Mode.OFFBOARD or not stream.engaged):
            stream.engaged = True
            self._switch(Mode.OFFBOARD)

    def _finish_takeoff(self, motion: Motion, now_s: float) -> None:
        """Report a takeoff finished, which switches to HOLD even if OFFBOARD took over in the meantime."""
        if self.mode is Mode.TAKEOFF and self._reached_s is None:
            below = self.takeoff_altitude_m - motion.altitude
            if below <= min(self._parameters["NAV_MC_ALT_RAD"], self.takeoff_altitude_m / 2):
                self._reached_s = now_s
        if self._reached_s is not None and now_s - self._reached_s >= _TAKEOFF_SETTLE_S:
            self._wanted = Mode.HOLD
            self._offboard.engaged = False
            self._switch(Mode.HOLD)

    def _fence(self, motion: Motion, now_s: float) -> None:
        """Hold at the geofence, where one is set (GF_ACTION 2; 3 returns)."""
        action = {2: Mode.HOLD, 3: Mode.RTL, 5: Mode.LAND}.get(int(self._parameters["GF_ACTION"]))
        across, up = self._parameters["GF_MAX_HOR_DIST"], self._parameters["GF_MAX_VER_DIST"]
        out = 0 < across < math.hypot(motion.north, motion.east) or 0 < up < motion.altitude
        if out and action and self._wanted not in (action, Mode.LAND, Mode.RTL):
            self._say(Severity.CRITICAL, f"Geofence violated, {action.name}")
            self.request(action, now_s)

    def _detect_landing(self, motion: Motion, now_s: float) -> None:
        if not motion.on_gear or abs(motion.v_down) > _STILL_M_S:
            self._still_since_s = now_s
        if self.landed and self.armed and not motion.on_gear and motion.altitude > 0.1:
            self.landed, self._flown = False, True
            self._say(Severity.INFO, "Takeoff detected")
        elif not self.landed and now_s - self._still_since_s >= _LANDED_S:
            self.landed, self._landed_s = True, now_s
            self._say(Severity.INFO, "Landing detected")

    def _disarm_when_idle(self, now_s: float) -> None:
        if not self.landed or self.mode is Mode.TAKEOFF:
            return
        since_s = self._landed_s if self._flown else self._armed_s
        name = "COM_DISARM_LAND" if self._flown else "COM_DISARM_PRFLT"
        if 0 < self._parameters[name] <= now_s - since_s:
            self._disarm("Disarmed by landing" if self._flown else "Disarmed by auto preflight disarming")

    def _say(self, severity: Severity, text: str) -> None:
        self.texts.append((severity, text[:50]))
