"""The drone's dynamics: JSBSim's F450 quadrotor at 250 Hz under a velocity controller."""

from __future__ import annotations

import enum
import math
from pathlib import Path

import jsbsim
import numpy as np

from adatracker_deploy.core.geometry import Pose, wrap_angle
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.platform import Body
from adatracker_drone.protocol.frames import NedPose
from adatracker_drone.protocol.setpoints import body_velocity
from adatracker_drone.sim.flight_controller import Cascade, Motors
from adatracker_drone.sim.motion import (
    HOME_ALTITUDE_M,
    HOME_LATITUDE_DEG,
    HOME_LONGITUDE_DEG,
    Motion,
    Velocity,
)
from adatracker_drone.sim.settings import SitlSettings

STEP_S = 0.004
"""JSBSim's and the controller's time step."""

_FT_M = 0.3048
_STANDING_M = 0.15068
"""Height of the centre of mass above the ground when the vehicle stands on its springs, measured."""
_BREAKS_M_S = 5.0
"""Touching down faster than this is a crash; the model's gear would throw the vehicle back into the air."""
_DEEPEST_M = 0.5
"""Deeper in the ground is a vehicle that turned over, for only the gear touches."""
_HOVER = 0.4155
_SPIN_UP_STEPS = 150
"""Motors reach hover speed within 0.6 s (lag 56 ms)."""
_GUST_TIME_S = 2.0
"""Correlation time of gusts: tens of metres of eddies at a few m/s."""

_COMMANDS = tuple(f"fcs/cmd{motor}_ext_nd" for motor in ("FR", "AL", "FL", "AR"))
_INTEGRATORS = tuple(
    f"simulation/integrator/{of}/{kind}"
    for of in ("rate", "position")
    for kind in ("rotational", "translational")
)
_READ = (
    *(f"position/from-start-neu-{axis}-ft" for axis in "ne"),
    "position/h-agl-ft",
    *(f"velocities/v-{axis}-fps" for axis in ("north", "east", "down")),
    *(f"attitude/{angle}-rad" for angle in ("phi", "theta", "psi")),
    *(f"velocities/{rate}-rad_sec" for rate in "pqr"),
    *(f"gear/unit[{unit}]/WOW" for unit in range(3)),
)


class Power(enum.Enum):
    """State of the motors."""

    OFF = enum.auto()
    IDLE = enum.auto()
    """They turn and lift nothing: armed on the ground."""
    FLY = enum.auto()
    """They follow the velocity demand."""


_STILL: dict[Power, Motors] = {Power.OFF: (0.0, 0.0, 0.0, 0.0), Power.IDLE: (0.08, 0.08, 0.08, 0.08)}


class _Silence(jsbsim.FGLogger):  # type: ignore[misc]
    """JSBSim prints a page at every start; nobody reads it."""

    def set_level(self, level: object) -> None: ...
    def file_location(self, filename: str, line: int) -> None: ...
    def message(self, message: str) -> None: ...
    def format(self, format: object) -> None: ...  # noqa: A002 - the base class names it so
    def flush(self) -> None: ...


class DroneBody(Body):
    """A 1.4 kg quadrotor; its origin is the point between the feet of its gear.

    A pose at z = 0 stands on the ground with its motors off until `power` says otherwise; any other hovers.
    """

    def __init__(self, settings: SitlSettings | None = None) -> None:
        self.settings = settings or SitlSettings()
        self.power = Power.OFF
        self.motion = Motion()
        self.reset(Pose(), 0)

    def reset(self, pose: Pose, seed: int) -> None:
        """Start level at `pose` (roll and pitch are ignored) with this seed's wind.

        JSBSim is made anew each time: running its initial conditions again is not repeatable to the bit.
        """
        self._random = np.random.default_rng([seed, 0xB0D7])
        self._dt_left_s = 0.0
        self._cascade = Cascade()
        self._wrecked = False
        start = NedPose.from_enu(pose)
        self._model = _model(max(-start.down, 0.0), start.heading)
        node = self._model.get_property_manager().get_node
        self._command_nodes = [node(name) for name in _COMMANDS]
        self._read_nodes = [node(name) for name in _READ]
        self._wind_nodes = [node(f"atmosphere/wind-{axis}-fps") for axis in ("north", "east")]
        self.power = Power.FLY if pose.z > 0 else Power.OFF
        if self.power is Power.FLY:
            self._spin_up()
        north_ft, east_ft = (entry.get_double_value() for entry in self._read_nodes[:2])
        self._origin_ft = (north_ft - start.north / _FT_M, east_ft - start.east / _FT_M)
        direction = self._random.uniform(-math.pi, math.pi)
        self._mean_wind = self.settings.wind_m_s * np.array([math.cos(direction), math.sin(direction)])
        self._gust = self.settings.gust_m_s * self._random.standard_normal(2)
        self.motion = self._read()

    def step(self, command: Twist, dt_s: float) -> None:
        """Advance by `dt_s` seconds, in steps of `STEP_S`; what is left over is kept for the next call."""
        demand = Velocity(command.vx, -command.vy, -command.vz, -command.yaw_rate)
        self._dt_left_s += dt_s
        while self._dt_left_s > STEP_S / 2:
            self._dt_left_s -= STEP_S
            self._blow()
            still = _STILL.get(self.power)
            self._run(still or self._cascade.step(demand, self.motion, STEP_S))
            motion = self._read()
            crashes = motion.on_gear and self.motion.v_down > _BREAKS_M_S
            lost = motion.down > _DEEPEST_M or not math.isfinite(sum(motion))  # NaN: JSBSim gave up
            self._wrecked = self._wrecked or crashes or lost
            self.motion = _at_rest(self.motion) if self._wrecked else motion

    @property
    def pose(self) -> Pose:
        """Pose of the origin; x east, y north."""
        m = self.motion
        return NedPose(m.north, m.east, m.down, m.roll, m.pitch, m.heading).to_enu()

    @property
    def camera_pose(self) -> Pose:
        """Pose of the camera, fixed to the airframe: it tilts with it."""
        return self.settings.camera.pose(self.pose)

    @property
    def velocity(self) -> Twist:
        """The velocity in the level frame that turns with the heading, as commands are given."""
        m = self.motion
        return body_velocity((m.v_north, m.v_east, m.v_down), m.heading, m.r)

    def _run(self, motors: Motors) -> None:
        for entry, value in zip(self._command_nodes, motors, strict=True):
            entry.set_double_value(value)
        self._model.run()

    def _read(self) -> Motion:
        north, east, height, vn, ve, vd, roll, pitch, psi, p, q, r, *gear = [
            entry.get_double_value() for entry in self._read_nodes
        ]
        return Motion(
            north=(north - self._origin_ft[0]) * _FT_M,
            east=(east - self._origin_ft[1]) * _FT_M,
            down=_STANDING_M - height * _FT_M,
            v_north=vn * _FT_M,
            v_east=ve * _FT_M,
            v_down=vd * _FT_M,
            roll=roll,
            pitch=pitch,
            heading=wrap_angle(psi),
            p=p,
            q=q,
            r=r,
            on_gear=any(gear),
        )

    def _blow(self) -> None:
        """Let the wind change: a mean and an Ornstein-Uhlenbeck gust on each horizontal axis."""
        if not (self.settings.wind_m_s or self.settings.gust_m_s):
            return
        decay = STEP_S / _GUST_TIME_S
        kick = self.settings.gust_m_s * math.sqrt(2 * decay)
        self._gust += kick * self._random.standard_normal(2) - decay * self._gust
        for entry, speed in zip(self._wind_nodes, self._mean_wind + self._gust, strict=True):
            entry.set_double_value(float(speed) / _FT_M)

    def _spin_up(self) -> None:
        """Bring the motors to hover speed while the vehicle is held where it is."""
        integrators = {name: self._model[name] for name in _INTEGRATORS}
        for name in integrators:
            self._model[name] = 0  # no integration: frozen
        for _ in range(_SPIN_UP_STEPS):
            self._run((_HOVER,) * 4)
        for name, kind in integrators.items():
            self._model[name] = kind


def _model(height_m: float, heading_rad: float) -> jsbsim.FGFDMExec:
    """Return a fresh F450 at rest, level, engines on and not yet turning."""
    jsbsim.set_logger(_SILENCE)
    # Not `get_default_root_dir`, which finds nothing where a .pth file adds the environment.
    model = jsbsim.FGFDMExec(str(Path(jsbsim.__file__).parent))
    model.set_debug_level(0)
    model.load_model("F450")
    model.set_dt(STEP_S)
    model["ic/lat-geod-deg"] = HOME_LATITUDE_DEG
    model["ic/long-gc-deg"] = HOME_LONGITUDE_DEG
    model["ic/terrain-elevation-ft"] = HOME_ALTITUDE_M / _FT_M
    model["ic/h-agl-ft"] = (_STANDING_M + height_m) / _FT_M
    model["ic/psi-true-rad"] = heading_rad % math.tau
    model.run_ic()
    model["propulsion/set-running"] = -1
    return model


def _at_rest(motion: Motion) -> Motion:
    """Return a wreck: it lies where it was last and does not move."""
    return Motion(
        north=motion.north,
        east=motion.east,
        down=motion.down,
        roll=motion.roll,
        pitch=motion.pitch,
        heading=motion.heading,
        on_gear=True,
    )


_SILENCE = _Silence()
