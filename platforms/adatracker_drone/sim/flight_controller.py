"""The flight controller: velocity -> attitude -> body rate -> mixer, for JSBSim's F450. Pure arithmetic.

The structure is PX4's (mc_pos_control, mc_att_control, mc_rate_control), the gains are tuned to this
airframe. Motors are in the order front right, aft left, front left, aft right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from adatracker_drone.protocol.frames import rotate
from adatracker_drone.sim.motion import Motion, Velocity

Motors = tuple[float, float, float, float]
"""Commands in [0, 1]: front right, aft left, front left, aft right."""

GRAVITY_M_S2 = 9.81
MASS_KG = 1.4
INERTIA_KG_M2 = (0.0190, 0.0190, 0.0252)
"""About forward, right and down (the model's Mass.xml)."""
_ARM_M = 0.1651
"""Each motor's distance from the roll and the pitch axis (Propulsion.xml)."""
_TORQUE_M = 0.01965
"""A propeller's torque per thrust, measured on the model at any throttle."""
_FULL_THRUST_N, _THRUST_POWER = 15.53, 1.72
"""Static thrust of a motor is 15.53 N * command ** 1.72: exact in hover, within 4 % from 0.3 to 1."""
_MIX = ((-1, 1, 1), (1, -1, 1), (1, 1, -1), (-1, -1, -1))
"""Share of each motor's thrust in roll, pitch and yaw."""

_VELOCITY_P, _VELOCITY_I = 1.6, 0.15
_CLIMB_P, _CLIMB_I = 3.5, 1.0
_INTEGRAL_LIMIT_M_S2 = 3.0
_ATTITUDE_P = 4.5
_RATE_P = 10.0
_YAW_RATE_P, _YAW_RATE_I = 6.0, 2.0
_LIFTS_OFF_M_S = 0.05
"""On the ground only a demand to climb faster than this is one to lift off."""
_TILT_LIMIT_RAD = math.radians(30)
_RATE_LIMIT_RAD_S = math.radians(220)
_THRUST_LIMITS_N = (0.12 * 4 * 3.43, 4 * 9.0)
"""Never so little that attitude is lost, nor so much that none is left for it."""


def _clip(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


@dataclass(slots=True)
class Cascade:
    """Follows velocity demands; its only memory is its integrators."""

    _pull: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Integrated acceleration demand in north, east, down, m/s^2: fixed to the wind, not to the heading."""
    _twist: float = 0.0
    """Integrated yaw acceleration, rad/s^2."""

    def step(self, demand: Velocity, motion: Motion, dt_s: float) -> Motors:
        """Return the motor commands for the next `dt_s` seconds."""
        low, high = _THRUST_LIMITS_N
        if motion.on_gear and demand.down > -_LIFTS_OFF_M_S:
            # PX4's ground-contact state: let go, or the velocity loop would lean on the gear and tip over.
            return _mix(low, (0.0, 0.0, 0.0))
        forward, right, down = self._acceleration(demand, motion, dt_s)
        # Thrust acts along the body's up axis: tilt it towards the demand and lift the weight with the rest.
        lift = max(GRAVITY_M_S2 - down, 0.3 * GRAVITY_M_S2)
        pitch = _clip(math.atan2(-forward, lift), _TILT_LIMIT_RAD)
        roll = _clip(math.atan2(right * math.cos(pitch), lift), _TILT_LIMIT_RAD)
        upright = max(math.cos(motion.roll) * math.cos(motion.pitch), 0.5)
        thrust = min(max(MASS_KG * (GRAVITY_M_S2 - down) / upright, low), high)
        return _mix(thrust, self._torques(roll, pitch, demand.yaw_rate, motion, dt_s))

    def _acceleration(self, demand: Velocity, motion: Motion, dt_s: float) -> tuple[float, float, float]:
        """Return the acceleration demand: forward, right, down, m/s^2."""
        north, east = rotate(demand.forward, demand.right, motion.heading)
        errors = (north - motion.v_north, east - motion.v_east, demand.down - motion.v_down)
        for axis, gain in enumerate((_VELOCITY_I, _VELOCITY_I, _CLIMB_I)):
            self._pull[axis] = _clip(self._pull[axis] + gain * dt_s * errors[axis], _INTEGRAL_LIMIT_M_S2)
        forward, right = rotate(
            _VELOCITY_P * errors[0] + self._pull[0], _VELOCITY_P * errors[1] + self._pull[1], -motion.heading
        )
        # A velocity that is constant in a turning frame still turns: feed forward its acceleration, r x v.
        return (
            forward - motion.r * demand.right,
            right + motion.r * demand.forward,
            _CLIMB_P * errors[2] + self._pull[2],
        )

    def _torques(
        self, roll: float, pitch: float, yaw_rate: float, motion: Motion, dt_s: float
    ) -> tuple[float, float, float]:
        """Return the torques about forward, right and down, N m, that bring the attitude."""
        roll_rate = _clip(_ATTITUDE_P * (roll - motion.roll), _RATE_LIMIT_RAD_S)
        pitch_rate = _clip(_ATTITUDE_P * (pitch - motion.pitch), _RATE_LIMIT_RAD_S)
        # Euler rates to body rates, for small changes of roll and pitch about any attitude.
        p = roll_rate - yaw_rate * math.sin(motion.pitch)
        q = pitch_rate * math.cos(motion.roll) + yaw_rate * math.sin(motion.roll) * math.cos(motion.pitch)
        r = yaw_rate * math.cos(motion.roll) * math.cos(motion.pitch) - pitch_rate * math.sin(motion.roll)
        self._twist = _clip(self._twist + _YAW_RATE_I * dt_s * (r - motion.r), 1.0)
        about_roll, about_pitch, about_yaw = INERTIA_KG_M2
        return (
            about_roll * _RATE_P * (p - motion.p),
            about_pitch * _RATE_P * (q - motion.q),
            about_yaw * (_YAW_RATE_P * (r - motion.r) + self._twist),
        )


def _mix(thrust_n: float, torques: tuple[float, float, float]) -> Motors:
    """Share thrust and torques among the motors; yaw gives way first: falling over is worse than drifting."""
    share = thrust_n / 4
    roll, pitch = torques[0] / (4 * _ARM_M), torques[1] / (4 * _ARM_M)
    yaw = _clip(torques[2] / (4 * _TORQUE_M), 0.5 * share)
    return tuple(_command(share + a * roll + b * pitch + c * yaw) for a, b, c in _MIX)  # type: ignore[return-value]


def _command(thrust_n: float) -> float:
    """Return the command that gives one motor's thrust."""
    share: float = max(thrust_n, 0.0) / _FULL_THRUST_N
    return min(math.pow(share, 1 / _THRUST_POWER), 1.0)
