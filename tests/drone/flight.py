"""An autopilot flying a body in simulated time, for tests: no wire, no clock."""

import math

from pymavlink.dialects.v20 import common as mavlink

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Twist
from adatracker_drone.protocol.px4 import Mode, Result
from adatracker_drone.sim.autopilot import Autopilot
from adatracker_drone.sim.dynamics import STEP_S, DroneBody
from adatracker_drone.sim.settings import SitlSettings

EXACT = {
    "velocity_bias_m_s": 0.0,
    "velocity_wander_m_s": 0.0,
    "velocity_noise_m_s": 0.0,
    "position_noise_m": 0.0,
    "height_drift_m": 0.0,
}
STOCK = SitlSettings(parameters={}, **EXACT)
"""PX4's defaults and an estimator without error."""

BODY_NED, LOCAL_NED = mavlink.MAV_FRAME_BODY_NED, mavlink.MAV_FRAME_LOCAL_NED
VELOCITY_AND_YAW_RATE = 1479
POSITION_AND_YAW = 0b101111111000


class Flight:
    """An autopilot and the body it flies, and everything it said."""

    def __init__(self, settings=STOCK, *, seed=0, speed=1.0):
        self.body = DroneBody(settings)
        self.body.reset(Pose(), seed)
        self.autopilot = Autopilot(settings, seed, speed)
        self.commander = self.autopilot.commander
        self.t_s = 0.0
        self.said = []

    def run(self, seconds, *, stream=None, rate_hz=20.0):
        """Let time pass, sending a set-point at a rate if one is given."""
        until_s, next_s = self.t_s + seconds, self.t_s
        while self.t_s < until_s - STEP_S / 2:
            self.t_s += STEP_S
            if stream is not None and self.t_s >= next_s:
                self.send(stream)
                next_s += 1 / rate_hz
            demand = self.autopilot.step(self.body.motion, self.t_s)
            self.body.power = self.autopilot.power()
            self.body.step(Twist(demand.forward, -demand.right, -demand.down, -demand.yaw_rate), STEP_S)
            self.said += [(self.t_s, message) for message in self.autopilot.transmit()]
        return self

    def run_until(self, condition, timeout_s=30.0, **stream):
        end_s = self.t_s + timeout_s
        while not condition():
            assert self.t_s < end_s, f"still {self.mode} at {self.body.pose} after {timeout_s} s"
            self.run(0.1, **stream)
        return self

    def send(self, message, *, system=255):
        message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=190))
        self.autopilot.receive(message)

    def order(self, command, *params):
        """Send a command; return the answer."""
        filled = [*params, *[0.0] * (7 - len(params))]
        self.send(mavlink.MAVLink_command_long_message(1, 1, command, 0, *filled))
        self.run(STEP_S)
        return Result([m for m in self.of("COMMAND_ACK") if m.command == command][-1].result)

    def arm(self, *, force=False):
        return self.order(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, 21196 if force else 0)

    def disarm(self, *, force=False):
        return self.order(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196 if force else 0)

    def take_off(self):
        return self.order(mavlink.MAV_CMD_NAV_TAKEOFF, *[math.nan] * 7)

    def switch(self, mode):
        return self.order(mavlink.MAV_CMD_DO_SET_MODE, 129, *mode.value)

    def set(self, name, value):
        assert self.autopilot.parameters.set(name, value)
        return self

    def hover(self):
        """Arm, take off and wait for the hold that ends it."""
        self.run(1.0)
        assert self.arm() is Result.ACCEPTED
        assert self.take_off() is Result.ACCEPTED
        return self.run_until(lambda: self.mode is Mode.HOLD and not self.commander.landed).run(3.0)

    def offboard(self, stream):
        self.hover().run(1.1, stream=stream)
        assert self.switch(Mode.OFFBOARD) is Result.ACCEPTED
        return self.run(0.1, stream=stream)

    @property
    def mode(self):
        return self.commander.mode

    def of(self, kind):
        return [message for _, message in self.said if message.get_type() == kind]

    def texts(self):
        return " | ".join(message.text for message in self.of("STATUSTEXT"))


def velocity(forward=0.0, right=0.0, down=0.0, yaw_rate=0.0, *, frame=BODY_NED):
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, VELOCITY_AND_YAW_RATE, 0, 0, 0, forward, right, down, 0, 0, 0, 0, yaw_rate
    )


def place(north, east, down, heading=0.0):
    return mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, LOCAL_NED, POSITION_AND_YAW, north, east, down, 0, 0, 0, 0, 0, 0, heading, 0
    )


STILL = velocity()
