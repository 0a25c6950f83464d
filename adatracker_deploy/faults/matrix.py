"""What each fault is allowed: one row a fault, the same for every robot that can suffer it. Pure.

A limit is the time from a fault's onset until the last command that moves the robot has reached it; where
nothing can reach it any more, until the link has latched its stop, or until the robot itself stands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Measure = Literal["told", "latched", "stands", "gap", "burst", "acceleration", "log"]
"""What a row's limit is of: the last motion command, the link's latched stop, the robot's standing; or, where
the robot goes on: the commands' largest gap, the ticks' smallest, the acceleration asked for, and that the
trouble is told."""

TIMING: frozenset[Measure] = frozenset({"gap", "burst"})
"""Measures of the loop's timing itself: no other robot may be rehearsed beside them."""

STOPPED = frozenset({"safety_stop", "system_fault"})
TAKEN = frozenset({"takeover"})
WENT_ON = frozenset({"completed", "lost", "collision"})
INTERRUPTED = frozenset({"interrupted"})
KILLED = frozenset({""})
"""Who was killed says nothing."""

LOOK_S = 0.01
"""How often a far end looks what has come."""
SLOT_S = 0.02
"""Of the link."""


@dataclass(frozen=True, slots=True)
class Row:
    """One fault and what is allowed."""

    fault: str
    measure: Measure
    limit_s: float
    endings: frozenset[str]
    """How the trial may end."""
    only: dict[str, float] | None = None
    """Other limits of single platforms, s."""
    why: str = ""
    """What the limit is made of, where it is no round promise."""
    exit_s: float = math.inf
    """Within which the command must have ended, too; a drone lands first."""

    def limit_of(self, platform: str) -> float:
        """Return the limit that holds for a platform, s."""
        return (self.only or {}).get(platform, self.limit_s)


ROWS = (
    Row("camera_freeze", "told", 0.3, STOPPED),
    Row("camera_gone", "told", 0.3, STOPPED),
    Row("segmenter_stall", "told", 0.3, STOPPED),
    Row("segmenter_error", "told", 0.3, STOPPED),
    Row("policy_nan", "told", 0.1, STOPPED, why="the same tick"),
    Row("policy_inf", "told", 0.1, STOPPED, why="the same tick"),
    Row("policy_hang", "told", 0.2, STOPPED),
    Row("tracker_stop", "told", 0.2, STOPPED),
    Row("tracker_kill", "told", 0.2, KILLED),
    Row("link_stop", "stands", 2.0, STOPPED | TAKEN, {"drone": 3.0}, "the robot's own time-out, and braking"),
    Row("link_kill", "stands", 2.0, STOPPED, {"drone": 3.0}, "the robot's own time-out, and braking"),
    Row("interrupt", "told", 0.2, INTERRUPTED, exit_s=2.0),
    Row("terminate", "told", 0.2, INTERRUPTED, exit_s=2.0),
    Row("link_drop", "latched", 0.3, STOPPED, {"wheeled": 0.2}),
    Row("robot_silent", "told", 0.3, STOPPED | TAKEN),
    Row("battery_low", "told", 2.0, STOPPED, why="1 s, and 1 s until it is told"),
    Row("remote_control", "told", 0.3, TAKEN),
    Row("emergency_stop", "told", 0.3, TAKEN),
    Row("base_fault", "told", 0.3, STOPPED | TAKEN),
    Row("frozen_feedback", "told", 0.3, STOPPED),
    Row("frozen_state", "told", 0.6, STOPPED, why="its time-out is 0.5 s"),
    Row("frozen_odometry", "told", 0.4, STOPPED, why="its time-out is 0.3 s"),
    Row("cpu_hogs", "burst", 0.49, WENT_ON | STOPPED, why="two ticks at least half a period apart"),
    Row("gc_pause", "gap", 0.01 + LOOK_S, WENT_ON, why="with the far end's look, 20 ms"),
    Row("action_jump", "acceleration", 1.0, WENT_ON | STOPPED, why="never above the profile's"),
    Row("disk_full", "log", 0.0, WENT_ON, why="and the trouble is told"),
)
"""What is struck while the robot follows."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """What is wrong from the start, and must be refused before anything moves."""

    name: str
    says: str
    status: int
    words: str
    """What the one line says, among other words."""


REFUSALS = (
    Refusal("log_readonly", "the log folder cannot be written", 2, "cannot be written"),
    Refusal("model_corrupt", "a byte of the policy's network is another", 2, "SHA-256"),
    Refusal("model_wrong_shape", "the network has other outputs than its manifest says", 2, "policy.onnx"),
    Refusal("profile_malformed", "a limit of the profile is not a number", 2, "accel_m_s2"),
    Refusal("battery_at_start", "5 % of the charge, before it is armed", 1, "not ready"),
)

NOT_SHOWN = {
    "wall_clock_jump": "setting the clock takes root and moves every program's; control, time-outs and logs "
    "count on the monotonic clock, wall-clock time is only written down",
    "can_bus_off": "bus-off, ENOBUFS and a downed interface need SocketCAN in the kernel: tests/wheeled/uml",
    "hostile_packets": "a flood of rubbish is a test of each wire's parser: tests/wheeled, quadruped, drone",
}
"""What else can break, and why the matrix has no row for it."""

_ROS = "ROS 2 messages cannot tell it"
_STREAMS = "its streams come from one autopilot: see robot_silent"
_REASONS = {
    ("drone", "camera_gone"): "its camera is drawn in the tracker, no server can go: see camera_freeze",
    ("drone", "remote_control"): "a pilot who changes the mode is in tests/drone",
    ("drone", "emergency_stop"): "there is none in the air",
    ("drone", "base_fault"): "its autopilot's own fail-safes decide",
    ("drone", "frozen_feedback"): _STREAMS,
    ("drone", "frozen_state"): _STREAMS,
    ("drone", "frozen_odometry"): _STREAMS,
    ("quadruped", "remote_control"): _ROS,
    ("quadruped", "emergency_stop"): _ROS,
    ("quadruped", "base_fault"): _ROS,
    ("quadruped", "frozen_state"): _ROS,
    ("quadruped", "frozen_feedback"): "see frozen_odometry",
    ("wheeled", "frozen_odometry"): "see frozen_feedback",
}


def absent(platform: str, fault: str) -> str:
    """Return why a platform cannot suffer a fault in a rehearsal."""
    return _REASONS.get((platform, fault), "its far end does not know it")
