"""The fault matrix: one row with its limit per fault, for every robot that supports it. Pure.

A limit is the time from a fault's onset until the last motion command has reached the robot; if no command
can reach it any more, until the link has latched its stop, or until the robot itself stands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

from adatracker_deploy.faults.phases import TrialPhase

FOLLOWED_S = 2.0
"""Time of a fault while following, s: the person walks, and the robot is up to speed."""

Measure = Literal[
    "told", "latched", "stands", "quiet", "woken", "climbs", "gap", "burst", "acceleration", "log"
]
"""The measure of a row: the last motion command, the link's latched stop, the robot's standstill, the last
motion command while the fault lasts or after the machine has woken, the last climb of a drone; or, where the
robot goes on: the largest gap between commands, the smallest between ticks, the commanded acceleration, and
that the trouble is reported."""

TIMING: frozenset[Measure] = frozenset({"gap", "burst"})
"""Measures of the loop's timing; their rows must not run beside another rehearsal."""

STOPPED = frozenset({"safety_stop", "system_fault"})
TAKEN = frozenset({"takeover"})
WENT_ON = frozenset({"completed", "lost", "collision"})
INTERRUPTED = frozenset({"interrupted"})
KILLED = frozenset({""})
"""A killed process reports no outcome."""
ANY = STOPPED | TAKEN | WENT_ON | INTERRUPTED | KILLED

LOOK_S = 0.01
"""Polling interval of a simulator."""
SLOT_S = 0.02
"""The link's period."""


@dataclass(frozen=True, slots=True)
class Row:
    """One fault and its limit."""

    fault: str
    measure: Measure
    limit_s: float
    endings: frozenset[str]
    """The outcomes that the trial may have."""
    only: dict[str, float] | None = None
    """Different limits for single platforms, s."""
    why: str = ""
    """The derivation of the limit, if it is not a round number."""
    exit_s: float = math.inf
    """Time within which the command must also have ended; a drone lands first."""
    words: str = ""
    """Regular expression that the run's reason must match."""
    phase: TrialPhase = TrialPhase.FOLLOWING
    after_s: float = FOLLOWED_S
    """Time of the injection, s after the phase has begun."""
    on: tuple[str, ...] = ()
    """The platforms on which it is tested; empty for all that support it."""
    elsewhere: str = ""
    """The reason why it is not tested on the others."""
    trials: int = 1
    ends_run: bool = False
    """Nothing may engage after it."""
    lands: bool = True
    """A flying robot must have landed in the end."""
    again: bool = False
    """A second run follows, with the robot as the first left it."""
    variant: str = ""
    """Distinguishes rows of the same fault and phase."""
    changes: dict[str, dict[str, Any]] | None = None
    """Changes to the profile, by section."""

    @property
    def name(self) -> str:
        """Return its name as for ``--fault`` of the matrix; while following, just the fault."""
        return (
            self.fault if self.phase is TrialPhase.FOLLOWING else f"{self.fault}@{self.phase}{self.variant}"
        )

    @property
    def moves(self) -> bool:
        """Whether the robot must be moving at the onset."""
        return self.phase in (TrialPhase.FOLLOWING, TrialPhase.STOPPING)

    @property
    def stops(self) -> bool:
        """Whether the fault must end the trial, and with it the whole command."""
        return not self.endings & WENT_ON

    def limit_of(self, platform: str) -> float:
        """Return the limit for a platform, s."""
        return (self.only or {}).get(platform, self.limit_s)


FOLLOWING = (
    Row("camera_freeze", "told", 0.3, STOPPED),
    Row("camera_gone", "told", 0.3, STOPPED),
    Row("segmenter_stall", "told", 0.3, STOPPED),
    Row("segmenter_error", "told", 0.3, STOPPED),
    Row("policy_nan", "told", 0.1, STOPPED, why="the same tick"),
    Row("policy_inf", "told", 0.1, STOPPED, why="the same tick"),
    Row("policy_hang", "told", 0.2, STOPPED),
    Row("tracker_stop", "told", 0.2, STOPPED),
    Row("tracker_kill", "told", 0.2, KILLED, again=True),
    Row("link_stop", "stands", 2.0, STOPPED | TAKEN, {"drone": 3.0}, "the robot's own time-out, and braking"),
    Row(
        "link_kill",
        "stands",
        2.0,
        STOPPED,
        {"drone": 3.0},
        "the robot's own time-out, and braking",
        again=True,
    ),
    Row("interrupt", "told", 0.2, INTERRUPTED, exit_s=2.0),
    Row("terminate", "told", 0.2, INTERRUPTED, exit_s=2.0),
    Row("hangup", "told", 0.2, INTERRUPTED, exit_s=2.0),
    Row("suspend", "woken", 0.0, STOPPED | TAKEN, again=True),
    Row("robot_frozen", "stands", 3.0, STOPPED | TAKEN, {"drone": 3.5}, "2 s frozen, and braking"),
    Row("takeover", "told", 0.3, TAKEN, lands=False),
    Row("link_drop", "latched", 0.3, STOPPED, {"wheeled": 0.2}),
    Row("robot_silent", "told", 0.3, STOPPED | TAKEN),
    Row("battery_low", "told", 2.0, STOPPED, why="1 s, and 1 s until it is reported"),
    Row("remote_control", "told", 0.3, TAKEN),
    Row("emergency_stop", "told", 0.3, TAKEN),
    Row("base_fault", "told", 0.3, STOPPED | TAKEN),
    Row("frozen_feedback", "told", 0.3, STOPPED),
    Row("frozen_state", "told", 0.6, STOPPED, why="its time-out is 0.5 s"),
    Row("frozen_odometry", "told", 0.4, STOPPED, why="its time-out is 0.3 s"),
    Row("cpu_hogs", "burst", 0.49, WENT_ON | STOPPED, why="two ticks at least half a period apart"),
    Row("gc_pause", "gap", 0.01 + LOOK_S, WENT_ON, why="with the simulator's look, 20 ms"),
    Row("action_jump", "acceleration", 1.0, WENT_ON | STOPPED, why="never above the profile's"),
    Row("disk_full", "log", 0.0, WENT_ON, why="and the failure is reported"),
)
"""Rows of faults while following, before their expected reasons are added."""

_OPERATOR = "operator|interrupted"
_SILENCE = "deadlines_missed|command_lost"
_WORDS = {
    "camera_freeze": "camera|picture|frame",
    "camera_gone": "camera|picture|frame",
    "segmenter_stall": "camera|picture|frame",
    "segmenter_error": "segmenter_error",
    "policy_nan": "not_finite",
    "policy_inf": "not_finite",
    "policy_hang": _SILENCE,
    "tracker_stop": _SILENCE,
    "link_kill": "link process died",
    "interrupt": _OPERATOR,
    "terminate": _OPERATOR,
    "hangup": _OPERATOR,
    "battery_low": "battery",
    "suspend": "suspend",
}
"""Expected reason of a trial stopped by each fault: a regular expression."""


def with_words(row: Row) -> Row:
    """Return a row with its expected reason, if it must end the trial in a reported way."""
    tells = row.stops and not row.endings & KILLED
    return replace(row, words=row.words or _WORDS.get(row.fault, "")) if tells else row


ROWS = tuple(map(with_words, FOLLOWING))
"""Rows of faults while following."""


@dataclass(frozen=True, slots=True)
class Refusal:
    """A request that is wrong from the start, and must be refused before anything moves."""

    name: str
    says: str
    status: int
    words: str
    """Text that the error line must contain."""


REFUSALS = (
    Refusal("log_readonly", "the log folder cannot be written", 2, "nothing can be made in"),
    Refusal("model_corrupt", "one byte of the policy's network is changed", 2, "SHA-256"),
    Refusal("model_wrong_shape", "the network has other outputs than its manifest says", 2, "policy.onnx"),
    Refusal("profile_malformed", "a limit of the profile is not a number", 2, "accel_m_s2"),
    Refusal("battery_at_start", "5 % of the charge, before it is armed", 1, "not ready"),
)

NOT_SHOWN = {
    "wall_clock_jump": "setting the clock takes root and moves every program's; control, time-outs and logs "
    "count on the monotonic clock, wall-clock time is only written down",
    "can_bus_off": "bus-off, ENOBUFS and a downed interface need SocketCAN in the kernel: tests/wheeled/uml",
    "hostile_packets": "a flood of malformed messages is a test of each wire's parser: tests/wheeled, "
    "quadruped, drone",
}
"""Other faults, and why the matrix has no row for them."""

_ROS = "ROS 2 messages do not carry it"
_STREAMS = "its streams come from one autopilot: see robot_silent"
_REASONS = {
    ("drone", "camera_gone"): "its camera is drawn in the tracker, so no server can fail: see camera_freeze",
    ("drone", "remote_control"): "a pilot who changes the mode is in tests/drone",
    ("drone", "emergency_stop"): "none exists in the air",
    ("drone", "base_fault"): "its autopilot's own fail-safes decide",
    ("drone", "frozen_feedback"): _STREAMS,
    ("drone", "frozen_state"): _STREAMS,
    ("drone", "frozen_odometry"): _STREAMS,
    ("quadruped", "remote_control"): _ROS,
    ("quadruped", "takeover"): _ROS,
    ("quadruped", "emergency_stop"): _ROS,
    ("quadruped", "base_fault"): _ROS,
    ("quadruped", "frozen_state"): _ROS,
    ("quadruped", "frozen_feedback"): "see frozen_odometry",
    ("ros2", "remote_control"): "another commander is another node: see takeover",
    ("ros2", "emergency_stop"): _ROS,
    ("ros2", "base_fault"): _ROS,
    ("ros2", "frozen_state"): _ROS,
    ("ros2", "frozen_feedback"): "see frozen_odometry",
    ("wheeled", "frozen_odometry"): "see frozen_feedback",
}


def absent(platform: str, fault: str) -> str:
    """Return why a fault cannot be rehearsed on a platform."""
    return _REASONS.get((platform, fault), "its simulator does not support it")
