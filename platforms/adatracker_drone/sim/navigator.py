"""PX4's navigator: a velocity demand from the flight mode, the vehicle's motion and a set-point.

The speeds are PX4's parameters; the position loop's gains are those of its mc_pos_control.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from adatracker_deploy.core.geometry import wrap_angle
from adatracker_drone.protocol.frames import rotate
from adatracker_drone.protocol.px4 import Mode
from adatracker_drone.sim.motion import Motion, Velocity
from adatracker_drone.sim.parameters import Parameters

_POSITION_P, _ALTITUDE_P, _HEADING_P = 0.95, 1.2, 2.8
"""1/s: MPC_XY_P, MPC_Z_P (1.0 by default), MC_YAW_P."""
_BRAKING_DELAY_S, _BRAKING_M_S2 = 0.6, 3.0
"""A moving vehicle that is to stay holds the place where it can stop, v (v / (2 MPC_ACC_HOR) + 0.6 s) ahead
(PX4, Navigator::preproject_stop_point); up and down, of which that says nothing, 0.6 s ahead."""
_SLOW_LANDING_BELOW_M = 5.0
"""MPC_LAND_ALT2: above it a landing descends at up to MPC_Z_VEL_MAX_DN."""
_HOME_M = 0.6
"""Near enough to home to descend."""


class Ned(NamedTuple):
    """Three numbers: north, east, down; NaN where a set-point says nothing."""

    north: float
    east: float
    down: float


NOTHING = Ned(math.nan, math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class SetPoint:
    """An offboard sender's set-point; NaN means not asked for, as in PX4's trajectory_setpoint."""

    position: Ned = NOTHING
    """m, in the local frame."""
    velocity: Ned = NOTHING
    """m/s; of (forward, right, down) when `level_body` is set."""
    level_body: bool = False
    """The velocity turns with the heading, not with roll and pitch (MAV_FRAME_BODY_NED)."""
    heading: float = math.nan
    """rad, clockwise from north."""
    yaw_rate: float = math.nan
    """rad/s, clockwise."""

    @property
    def asks(self) -> bool:
        """Return whether there is anything in it to follow; PX4 ignores one with nothing."""
        return any(map(math.isfinite, (*self.position, *self.velocity)))


def _finite(value: float) -> float:
    return value if math.isfinite(value) else 0.0


class Navigator:
    """Turns a mode into velocities; remembers only the place it holds."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._mode = Mode.HOLD
        self._place = Ned(0.0, 0.0, 0.0)
        """Held by the modes that stay, climb, land or return."""
        self._heading = 0.0

    def enter(self, mode: Mode, motion: Motion, top_m: float) -> None:
        """Begin a mode; a hold that follows a takeoff keeps the takeoff's place."""
        after_takeoff = self._mode is Mode.TAKEOFF and mode is Mode.HOLD
        self._mode = mode
        if after_takeoff:
            return
        stopping_s = _BRAKING_DELAY_S + math.hypot(motion.v_north, motion.v_east) / (2 * _BRAKING_M_S2)
        self._place = Ned(
            motion.north + stopping_s * motion.v_north,
            motion.east + stopping_s * motion.v_east,
            motion.down + _BRAKING_DELAY_S * motion.v_down,
        )
        self._heading = motion.heading
        if mode is Mode.TAKEOFF:
            self._place = self._place._replace(down=min(-top_m, motion.down))
        elif mode is Mode.RTL:
            far = math.hypot(motion.north, motion.east) > self._parameters["RTL_MIN_DIST"]
            height = self._parameters["RTL_RETURN_ALT"] if far else 0.0
            self._place = Ned(0.0, 0.0, min(-height, motion.down))

    def demand(self, motion: Motion, set_point: SetPoint) -> Velocity:
        """Return the velocity to fly now."""
        mode = self._mode
        if mode is Mode.OFFBOARD:
            return self._follow(set_point, motion)
        north, east, down = self._toward(self._place, motion)
        limits = self._parameters
        if mode is Mode.TAKEOFF:
            down = max(down, -limits["MPC_TKO_SPEED"])
        elif mode is Mode.LAND:
            down = self._sink(motion)
        elif mode is Mode.RTL:
            away = math.hypot(motion.north, motion.east)
            if away < _HOME_M:
                down = self._sink(motion)
            elif motion.down - self._place.down > 1.0:
                north = east = 0.0  # climb first
        return self._limited(
            north, east, down, _HEADING_P * _finite(wrap_angle(self._heading - motion.heading)), motion
        )

    def _toward(self, place: Ned, motion: Motion) -> Ned:
        """Return the velocity that closes the distance to a place, axis by axis; none where it is NaN."""
        return Ned(
            _finite(_POSITION_P * (place.north - motion.north)),
            _finite(_POSITION_P * (place.east - motion.east)),
            _finite(_ALTITUDE_P * (place.down - motion.down)),
        )

    def _sink(self, motion: Motion) -> float:
        limits = self._parameters
        slow = motion.altitude < _SLOW_LANDING_BELOW_M
        return limits["MPC_LAND_SPEED"] if slow else limits["MPC_Z_VEL_MAX_DN"]

    def _follow(self, wanted: SetPoint, motion: Motion) -> Velocity:
        """Return what an offboard set-point asks for; an axis with nothing finite stands still."""
        north, east, down = wanted.velocity
        if wanted.level_body:
            north, east = rotate(north, east, motion.heading)
        toward = self._toward(wanted.position, motion)
        yaw_rate = _finite(wanted.yaw_rate)
        yaw_rate += _HEADING_P * _finite(wrap_angle(_finite(wanted.heading - motion.heading)))
        return self._limited(
            toward.north + _finite(north),
            toward.east + _finite(east),
            toward.down + _finite(down),
            yaw_rate,
            motion,
        )

    def _limited(self, north: float, east: float, down: float, yaw_rate: float, motion: Motion) -> Velocity:
        """Apply the vehicle's own limits and turn the velocity into the level body frame."""
        limits = self._parameters
        speed = math.hypot(north, east)
        scale = min(1.0, limits["MPC_XY_VEL_MAX"] / speed) if speed else 1.0
        forward, right = rotate(north * scale, east * scale, -motion.heading)
        fastest_turn = math.radians(limits["MC_YAWRATE_MAX"])
        return Velocity(
            forward=forward,
            right=right,
            down=min(max(down, -limits["MPC_Z_VEL_MAX_UP"]), limits["MPC_Z_VEL_MAX_DN"]),
            yaw_rate=min(max(yaw_rate, -fastest_turn), fastest_turn),
        )
