"""Limits of faults injected in other phases than following. Pure.

Before it follows, the robot must not be commanded to move at all; afterwards it is at rest or stopping. A
trial that has not moved yet may go on after a lasting fault, but nothing moves during the fault (``quiet``).

Behaviour of the toolkit alone is tested on one robot for each phase; behaviour of a protocol or a robot, on
each.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from adatracker_deploy.faults.matrix import (
    ANY,
    FOLLOWED_S,
    INTERRUPTED,
    KILLED,
    ROWS,
    STOPPED,
    TAKEN,
    WENT_ON,
    Row,
    with_words,
)
from adatracker_deploy.faults.phases import IN_FLIGHT, ORDER, TrialPhase

if TYPE_CHECKING:
    from collections.abc import Mapping

    from adatracker_deploy.faults.matrix import Measure

_AT_ONCE_S = 0.2
"""Limit until the last motion command, s, after a requested stop or the end of a process."""
_SOON_S = 0.3
"""The same for a fault that must first be detected."""
_STANDS_S = 2.0
_BRAKED = {"drone": 3.0}
"""A drone following at 1 m/s takes longer to brake."""
_DOWN_S = 0.5
_NOBODYS = "nobody drives it yet: a mode on the ground takes nothing over"
_SAME = "the toolkit's own code, the same for every robot"
_HANDLER = "the handler is Ctrl-C's: see interrupt"
_EXIT_S = 10.0
"""Limit for a command to exit after a stop request, s."""
DRONE, GROUND = ("drone",), ("quadruped", "ros2", "wheeled")
HIGH: dict[str, dict[str, Any]] = {
    "connection": {"takeoff_altitude_m": 9.0},
    "limits": {"altitude_m": [1.0, 12.0]},
}
"""Profile changes for a high take-off."""


def _in(phase: TrialPhase, *rows: Row, on: tuple[str, ...] = (), trials: int = 1) -> tuple[Row, ...]:
    """Assign rows to a phase, at its beginning by default, and to some platforms."""
    return tuple(
        with_words(
            replace(
                row,
                phase=phase,
                after_s=0.0 if row.after_s == FOLLOWED_S else row.after_s,
                on=row.on or on,
                trials=trials if row.ends_run else row.trials,
            )
        )
        for row in rows
    )


def _signals(
    measure: Measure,
    limit_s: float,
    only: dict[str, float] | None = None,
    endings: frozenset[str] = INTERRUPTED,
    *,
    again: bool = False,
) -> tuple[Row, ...]:
    """Return the rows of Ctrl-C and of the two other signals with its handler, each on one robot."""
    row = Row("interrupt", measure, limit_s, endings, only, exit_s=_EXIT_S, ends_run=True, again=again)
    return (
        row,
        replace(row, fault="terminate", on=("wheeled",), elsewhere=_HANDLER, again=False),
        replace(row, fault="hangup", on=("quadruped",), elsewhere=_HANDLER, again=False),
    )


_CONNECTING = _in(
    TrialPhase.CONNECTING,
    *_signals("told", 0.0),
    Row("tracker_kill", "told", 0.0, KILLED, on=("drone",), elsewhere=_SAME),
    Row("tracker_stop", "quiet", 0.0, ANY, on=("quadruped",), elsewhere=_SAME),
    Row("link_kill", "told", 0.0, STOPPED | KILLED, on=("wheeled",), elsewhere=_SAME),
    Row("link_stop", "quiet", 0.0, ANY, on=("drone",), elsewhere=_SAME),
    Row("link_drop", "quiet", 0.0, ANY),
    Row("robot_frozen", "quiet", 0.0, ANY),
    Row("takeover", "told", 0.0, STOPPED | KILLED, on=("wheeled",), elsewhere=_NOBODYS),
    Row("camera_gone", "quiet", 0.0, ANY, on=("wheeled",), elsewhere=_SAME),
    Row("suspend", "quiet", 0.0, ANY, on=("quadruped",), elsewhere=_SAME),
)
_ENGAGING = _in(
    TrialPhase.ENGAGING,  # for ground robots: a base takes 0.1 s, a legged robot none
    *_signals("told", _AT_ONCE_S, again=True),
    Row("tracker_kill", "told", _AT_ONCE_S, KILLED, again=True),
    Row("tracker_stop", "quiet", _SOON_S, ANY),
    Row("link_kill", "told", _AT_ONCE_S, STOPPED, again=True),
    Row("link_stop", "quiet", _SOON_S, ANY),
    Row("link_drop", "told", _SOON_S, STOPPED | TAKEN, again=True),
    Row("robot_frozen", "quiet", _SOON_S, ANY),
    Row("takeover", "told", _SOON_S, STOPPED | TAKEN),
    Row("camera_gone", "told", _SOON_S, STOPPED, on=("wheeled",), elsewhere=_SAME),
    Row("suspend", "woken", 0.0, STOPPED | TAKEN, again=True),
    on=GROUND,
)
_TAKE_OFF = (
    Row("interrupt", "climbs", _DOWN_S, INTERRUPTED, ends_run=True),
    Row("hangup", "climbs", _DOWN_S, INTERRUPTED, ends_run=True),
    Row("tracker_kill", "climbs", _DOWN_S, KILLED),
    Row("tracker_stop", "climbs", 2.5, STOPPED | TAKEN, why="1.5 s without a command, and braking"),
    Row("link_drop", "climbs", 2.5, STOPPED | TAKEN, why="2 s cut off, and braking"),
    Row("takeover", "climbs", 2.5, STOPPED | TAKEN, why="the pilot has control", lands=False),
    Row("suspend", "woken", 0.0, STOPPED | TAKEN),
)
_ARMED = _in(
    TrialPhase.ARMED,
    # At once, it may come between our last question whose the drone is and PX4's reading of our take-off.
    *(replace(row, after_s=0.3) if row.fault == "takeover" else row for row in _TAKE_OFF),
    on=DRONE,
)
_CLIMBING = _in(
    TrialPhase.CLIMBING,
    *(replace(row, again=row.fault in {"interrupt", "tracker_kill"}) for row in _TAKE_OFF),
    replace(_TAKE_OFF[0], variant=" to 9 m", changes=HIGH, after_s=1.5),
    Row("terminate", "climbs", _DOWN_S, INTERRUPTED, ends_run=True),
    Row("link_stop", "quiet", _SOON_S, ANY),
    Row("robot_frozen", "climbs", 4.5, STOPPED | TAKEN, why="2 s frozen, and braking"),
    on=DRONE,
)
_LOOKING = _in(
    TrialPhase.LOOKING,
    *_signals("told", _AT_ONCE_S),
    Row("tracker_kill", "told", _AT_ONCE_S, KILLED),
    Row("tracker_stop", "told", _AT_ONCE_S, STOPPED, on=("wheeled",), elsewhere=_SAME),
    Row("link_kill", "told", _AT_ONCE_S, STOPPED),
    Row("link_stop", "told", _AT_ONCE_S, STOPPED | TAKEN, on=("quadruped",), elsewhere=_SAME),
    Row("link_drop", "told", _SOON_S, STOPPED | TAKEN),
    Row(
        "robot_frozen",
        "told",
        2.0 + _SOON_S,
        STOPPED | TAKEN,
        why="commands that arrive in the 2 s freeze are read after it",
    ),
    Row("takeover", "told", _SOON_S, STOPPED | TAKEN, lands=False),
    Row("camera_gone", "told", _SOON_S, STOPPED),
    Row("suspend", "woken", 0.0, STOPPED | TAKEN),
)
_STOPPING = _in(
    TrialPhase.STOPPING,  # after a trial that was completed, from full speed
    *_signals("stands", _STANDS_S, _BRAKED, INTERRUPTED | WENT_ON),
    Row("tracker_kill", "stands", _STANDS_S, ANY, _BRAKED),
    Row("tracker_stop", "stands", _STANDS_S, ANY, _BRAKED, on=("wheeled", "drone"), elsewhere=_SAME),
    Row("link_kill", "stands", _STANDS_S, ANY, _BRAKED),
    Row("link_stop", "stands", _STANDS_S, ANY, _BRAKED, on=("quadruped", "drone"), elsewhere=_SAME),
    Row("link_drop", "stands", _STANDS_S, ANY, _BRAKED),
    Row("robot_frozen", "stands", 4.0, ANY, {"drone": 5.0}, "2 s frozen, and braking"),
    Row("takeover", "stands", _STANDS_S, ANY, _BRAKED, lands=False),
    Row("suspend", "stands", _STANDS_S, ANY, _BRAKED),
    trials=2,
)
_DISENGAGING = _in(
    TrialPhase.DISENGAGING,
    *_signals("told", 0.0, endings=INTERRUPTED | WENT_ON),
    Row("tracker_kill", "told", 0.0, ANY),
    Row("tracker_stop", "told", 0.0, ANY, on=DRONE, elsewhere=_SAME),
    Row("link_kill", "told", 0.0, ANY, on=GROUND),
    # Sooner, it was told HOLD and not LAND yet, and hovers.
    Row("link_kill", "told", 0.0, ANY, on=DRONE, after_s=0.5, variant=" once told to land"),
    Row("link_stop", "told", 0.0, ANY, on=DRONE, elsewhere=_SAME),
    Row("link_drop", "told", 0.0, ANY, on=("drone", "wheeled"), elsewhere="it stands and gets no commands"),
    Row("robot_frozen", "told", 0.0, ANY, on=DRONE, elsewhere="it stands already"),
    Row("takeover", "told", 0.0, ANY, lands=False),
    Row("suspend", "told", 0.0, ANY, on=DRONE, elsewhere=_SAME),
    trials=2,
)
_BETWEEN = _in(
    TrialPhase.BETWEEN,
    *_signals("told", 0.0, endings=INTERRUPTED | WENT_ON | KILLED),
    Row("tracker_kill", "told", 0.0, KILLED, ends_run=True, on=DRONE, elsewhere=_SAME),
    trials=2,
)
PHASE_ROWS = (
    *(*_CONNECTING, *_ENGAGING, *_ARMED, *_CLIMBING),
    *(*_LOOKING, *_STOPPING, *_DISENGAGING, *_BETWEEN),
)
"""Rows of faults in other phases than following."""

PHASE_FAULTS = (
    *("interrupt", "terminate", "hangup", "tracker_kill", "tracker_stop", "link_kill", "link_stop"),
    *("link_drop", "robot_frozen", "takeover", "camera_gone", "suspend"),
)
"""The faults in the table by phase."""

_NOBODY = "no link and no camera then: the next trial connects anew"
_PICTURES = "no picture decides anything then"
_FIRST_LOOK = "the first picture is looked at when it is engaged: see looking"
_NO_ROW: Mapping[tuple[str, TrialPhase], str] = {
    **{(fault, TrialPhase.BETWEEN): _NOBODY for fault in PHASE_FAULTS},
    ("camera_gone", TrialPhase.ARMED): _FIRST_LOOK,
    ("camera_gone", TrialPhase.CLIMBING): _FIRST_LOOK,
    ("camera_gone", TrialPhase.STOPPING): _PICTURES,
    ("camera_gone", TrialPhase.DISENGAGING): _PICTURES,
    ("terminate", TrialPhase.ARMED): _HANDLER,
    ("link_kill", TrialPhase.ARMED): "see climbing",
    ("link_kill", TrialPhase.CLIMBING): "nobody commands any more: PX4 ends its take-off and hovers in Hold "
    "until the pilot lands it",
    ("link_stop", TrialPhase.ARMED): "see climbing",
    ("robot_frozen", TrialPhase.ARMED): "see climbing",
}


def has_phase(phase: TrialPhase, *, flies: bool) -> bool:
    """Return whether a robot's trials have a phase: only a drone's have ARMED and CLIMBING."""
    return flies if phase in IN_FLIGHT else not (flies and phase is TrialPhase.ENGAGING)


def all_rows(platform: str, *, flies: bool) -> tuple[Row, ...]:
    """Return the rows of one robot, in the order of a trial's phases."""
    rows = [row for row in (*ROWS, *PHASE_ROWS) if has_phase(row.phase, flies=flies)]
    shown = [row for row in rows if not row.on or platform in row.on]
    return tuple(sorted(shown, key=lambda row: ORDER.index(row.phase)))


def absent_in_phase(platform: str, fault: str, phase: TrialPhase, *, flies: bool) -> str:
    """Return why a cell of the table by phase has no row; empty if it has one, or needs none."""
    rows = [row for row in PHASE_ROWS if (row.fault, row.phase) == (fault, phase)]
    if not has_phase(phase, flies=flies) or any(not row.on or platform in row.on for row in rows):
        return ""
    return next((row.elsewhere for row in rows if row.elsewhere), "") or _NO_ROW.get((fault, phase), "")
