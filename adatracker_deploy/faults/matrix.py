"""What each fault is allowed: one row a fault, the same for every robot that can suffer it. Pure.

A limit is the time from a fault's onset until the last command that moves the robot has reached it; where
nothing can reach it any more, until the link has latched its stop, or until the robot itself stands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

from adatracker_deploy.faults.phases import TrialPhase

FOLLOWED_S = 2.0
"""When a fault strikes a robot that follows: the person walks, and the robot has come up to speed."""

Measure = Literal[
    "told", "latched", "stands", "quiet", "woken", "climbs", "gap", "burst", "acceleration", "log"
]
"""What a row's limit is of: the last motion command, the link's latched stop, the robot's standing, the last
motion command while the fault lasts or after the machine has woken, the last moment at which a drone climbs;
or, where the robot goes on: the commands' largest gap, the ticks' smallest, the acceleration asked for, and
that the trouble is told."""

TIMING: frozenset[Measure] = frozenset({"gap", "burst"})
"""Measures of the loop's timing itself: no other robot may be rehearsed beside them."""

STOPPED = frozenset({"safety_stop", "system_fault"})
TAKEN = frozenset({"takeover"})
WENT_ON = frozenset({"completed", "lost", "collision"})
INTERRUPTED = frozenset({"interrupted"})
KILLED = frozenset({""})
"""Who was killed says nothing."""
ANY = STOPPED | TAKEN | WENT_ON | INTERRUPTED | KILLED

LOOK_S = 0.01
"""How often a simulator looks what has come."""
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
    words: str = ""
    """What must be among the reason that the run gives: a regular expression."""
    phase: TrialPhase = TrialPhase.FOLLOWING
    after_s: float = FOLLOWED_S
    """When it strikes, s after the phase has begun."""
    on: tuple[str, ...] = ()
    """The platforms that it is shown on; empty for all that can suffer it."""
    elsewhere: str = ""
    """Why it is not shown on the others."""
    trials: int = 1
    ends_run: bool = False
    """Nothing may be engaged any more after it."""
    lands: bool = True
    """A robot that flies must have landed in the end."""
    again: bool = False
    """A second run follows, with the robot as it was left."""
    variant: str = ""
    """Which of several rows of the same fault and phase."""
    changes: dict[str, dict[str, Any]] | None = None
    """What its profile has otherwise, by section."""

    @property
    def name(self) -> str:
        """Return it as ``--fault`` of the matrix takes it: of what is struck while following, the fault."""
        return (
            self.fault if self.phase is TrialPhase.FOLLOWING else f"{self.fault}@{self.phase}{self.variant}"
        )

    @property
    def moves(self) -> bool:
        """Whether the robot must be moving at the onset."""
        return self.phase in (TrialPhase.FOLLOWING, TrialPhase.STOPPING)

    @property
    def stops(self) -> bool:
        """Whether the fault must end the trial, and so all that was asked for."""
        return not self.endings & WENT_ON

    def limit_of(self, platform: str) -> float:
        """Return the limit that holds for a platform, s."""
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
    Row("battery_low", "told", 2.0, STOPPED, why="1 s, and 1 s until it is told"),
    Row("remote_control", "told", 0.3, TAKEN),
    Row("emergency_stop", "told", 0.3, TAKEN),
    Row("base_fault", "told", 0.3, STOPPED | TAKEN),
    Row("frozen_feedback", "told", 0.3, STOPPED),
    Row("frozen_state", "told", 0.6, STOPPED, why="its time-out is 0.5 s"),
    Row("frozen_odometry", "told", 0.4, STOPPED, why="its time-out is 0.3 s"),
    Row("cpu_hogs", "burst", 0.49, WENT_ON | STOPPED, why="two ticks at least half a period apart"),
    Row("gc_pause", "gap", 0.01 + LOOK_S, WENT_ON, why="with the simulator's look, 20 ms"),
    Row("action_jump", "acceleration", 1.0, WENT_ON | STOPPED, why="never above the profile's"),
    Row("disk_full", "log", 0.0, WENT_ON, why="and the trouble is told"),
)
"""What is struck while the robot follows, before what their reasons must say."""

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
"""What the reason of a trial that a fault has stopped must say, by fault: a regular expression."""


def with_words(row: Row) -> Row:
    """Return a row with what its reason must say, where it must end the trial in a way that can be told."""
    tells = row.stops and not row.endings & KILLED
    return replace(row, words=row.words or _WORDS.get(row.fault, "")) if tells else row


ROWS = tuple(map(with_words, FOLLOWING))
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
    Refusal("log_readonly", "the log folder cannot be written", 2, "nothing can be made in"),
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
    ("quadruped", "takeover"): _ROS,
    ("quadruped", "emergency_stop"): _ROS,
    ("quadruped", "base_fault"): _ROS,
    ("quadruped", "frozen_state"): _ROS,
    ("quadruped", "frozen_feedback"): "see frozen_odometry",
    ("wheeled", "frozen_odometry"): "see frozen_feedback",
}


def absent(platform: str, fault: str) -> str:
    """Return why a platform cannot suffer a fault in a rehearsal."""
    return _REASONS.get((platform, fault), "its simulator does not know it")
