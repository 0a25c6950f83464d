"""Phases x faults: what each fault is allowed when it strikes in another phase than following. Pure.

Before the robot follows it must not be told to move at all; after, it is at rest or on its way there. A fault
that lasts may let a trial go on that has not moved yet: nothing moves while it lasts (``quiet``).

What the toolkit does alone, whatever the robot, is shown on one robot for each phase; what a wire or a robot
does, on each.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from adatracker_deploy.faults.matrix import (
    ANY,
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

_AT_ONCE_S = 0.2
"""For a stop that is asked for, or a process that ends, until the last moving command."""
_SOON_S = 0.3
"""For what must be noticed first."""
_STANDS_S = 2.0
_BRAKED = {"drone": 3.0}
"""A drone that follows at 1 m/s brakes for longer."""
_DOWN_S = 0.5
_SAME = "the toolkit's own code, the same for every robot"
_HANDLER = "the handler is Ctrl-C's: see interrupt"
GROUND = ("quadruped", "wheeled")
HIGH = {
    "connection": {"takeoff_altitude_m": 9.0},
    "limits": {"altitude_m": [1.0, 12.0]},
}
"""A profile for a high take-off."""

_signal = partial(Row, endings=INTERRUPTED, after_s=0.0, exit_s=10.0, ends_run=True)
_stop = partial(Row, endings=STOPPED, after_s=0.0)


def _signals(phase: TrialPhase, measure: str, limit_s: float, **more: object) -> tuple[Row, ...]:
    """Return the rows of Ctrl-C, on every robot, and of the two signals that its handler takes too."""
    row = partial(_signal, measure=measure, limit_s=limit_s, phase=phase, **more)
    return (
        row("interrupt"),
        row("terminate", on=("wheeled",), elsewhere=_HANDLER),
        row("hangup", on=("quadruped",), elsewhere=_HANDLER),
    )


def _connecting() -> tuple[Row, ...]:
    at = {"phase": TrialPhase.CONNECTING, "after_s": 0.0}
    quiet = partial(Row, measure="quiet", limit_s=0.0, endings=ANY, **at)
    return (
        *_signals(TrialPhase.CONNECTING, "told", 0.0),
        Row("tracker_kill", "told", 0.0, KILLED, on=("drone",), elsewhere=_SAME, **at),
        quiet("tracker_stop", on=("quadruped",), elsewhere=_SAME),
        _stop("link_kill", "told", 0.0, phase=TrialPhase.CONNECTING, on=("wheeled",), elsewhere=_SAME),
        quiet("link_stop", on=("drone",), elsewhere=_SAME),
        quiet("link_drop"),
        quiet("robot_frozen"),
        Row("takeover", "told", 0.0, STOPPED | TAKEN | KILLED, lands=False, **at),
        Row("camera_gone", "told", 0.0, STOPPED | WENT_ON | KILLED, on=("wheeled",), elsewhere=_SAME, **at),
        quiet("suspend", on=("quadruped",), elsewhere=_SAME),
    )


def _engaging() -> tuple[Row, ...]:
    """Of robots on the ground: a base takes 0.1 s, a robot on legs none."""
    at = {"phase": TrialPhase.ENGAGING, "on": GROUND, "after_s": 0.0}
    lasting = partial(Row, measure="quiet", limit_s=_SOON_S, endings=ANY, **at)
    signal = partial(_signal, measure="told", limit_s=_AT_ONCE_S, phase=TrialPhase.ENGAGING)
    return (
        signal("interrupt", on=GROUND, again=True),
        signal("terminate", on=("wheeled",), elsewhere=_HANDLER),
        signal("hangup", on=("quadruped",), elsewhere=_HANDLER),
        Row("tracker_kill", "told", _AT_ONCE_S, KILLED, again=True, **at),
        lasting("tracker_stop"),
        Row("link_kill", "told", _AT_ONCE_S, STOPPED, again=True, **at),
        lasting("link_stop"),
        Row("link_drop", "told", _SOON_S, STOPPED | TAKEN, again=True, **at),
        lasting("robot_frozen"),
        Row("takeover", "told", _SOON_S, STOPPED | TAKEN, **at),
        Row("camera_gone", "told", _SOON_S, STOPPED, **{**at, "on": ("wheeled",)}, elsewhere=_SAME),
        Row("suspend", "woken", 0.0, STOPPED | TAKEN, again=True, **at),
    )


def _take_off(phase: TrialPhase) -> tuple[Row, ...]:
    at = {"phase": phase, "after_s": 0.0, "on": ("drone",)}
    climbing = phase is TrialPhase.CLIMBING
    stopped = partial(Row, measure="climbs", endings=STOPPED | TAKEN, **at)
    rows = (
        Row("interrupt", "climbs", _DOWN_S, INTERRUPTED, ends_run=True, again=climbing, **at),
        Row("hangup", "climbs", _DOWN_S, INTERRUPTED, ends_run=True, **at),
        Row("tracker_kill", "climbs", _DOWN_S, KILLED, again=climbing, **at),
        stopped("tracker_stop", limit_s=2.5, why="1.5 s without a command, and braking"),
        stopped("link_drop", limit_s=2.5, why="2 s cut off, and braking"),
        stopped("takeover", limit_s=2.5, lands=False, why="it is the pilot's"),
        Row("suspend", "woken", 0.0, STOPPED | TAKEN, **at),
    )
    if not climbing:
        return rows
    return (
        *rows,
        Row(
            "interrupt",
            "climbs",
            _DOWN_S,
            INTERRUPTED,
            ends_run=True,
            variant=" to 9 m",
            changes=HIGH,
            **{**at, "after_s": 1.5},
        ),
        Row("terminate", "climbs", _DOWN_S, INTERRUPTED, ends_run=True, **at),
        Row("link_stop", "quiet", _SOON_S, ANY, **at),
        stopped("robot_frozen", limit_s=4.5, why="2 s frozen, and braking"),
    )


def _looking() -> tuple[Row, ...]:
    at = {"phase": TrialPhase.LOOKING, "after_s": 0.0}
    return (
        *_signals(TrialPhase.LOOKING, "told", _AT_ONCE_S),
        Row("tracker_kill", "told", _AT_ONCE_S, KILLED, **at),
        Row("tracker_stop", "told", _AT_ONCE_S, STOPPED, on=("wheeled",), elsewhere=_SAME, **at),
        Row("link_kill", "told", _AT_ONCE_S, STOPPED, **at),
        Row("link_stop", "told", _AT_ONCE_S, STOPPED | TAKEN, on=("quadruped",), elsewhere=_SAME, **at),
        Row("link_drop", "told", _SOON_S, STOPPED | TAKEN, **at),
        Row("robot_frozen", "told", _SOON_S, STOPPED | TAKEN, **at),
        Row("takeover", "told", _SOON_S, TAKEN | STOPPED, lands=False, **at),
        Row("camera_gone", "told", _SOON_S, STOPPED, **at),
        Row("suspend", "woken", 0.0, STOPPED | TAKEN, **at),
    )


def _stopping() -> tuple[Row, ...]:
    """After a trial that was completed, from full speed."""
    at = {"phase": TrialPhase.STOPPING, "after_s": 0.0}
    stands = partial(Row, measure="stands", limit_s=_STANDS_S, only=_BRAKED, endings=ANY, **at)
    return (
        *(
            _signal(name, "stands", _STANDS_S, only=_BRAKED, trials=2, phase=TrialPhase.STOPPING, **more)
            for name, more in (
                ("interrupt", {}),
                ("terminate", {"on": ("wheeled",), "elsewhere": _HANDLER}),
                ("hangup", {"on": ("quadruped",), "elsewhere": _HANDLER}),
            )
        ),
        stands("tracker_kill"),
        stands("tracker_stop", on=("wheeled", "drone"), elsewhere=_SAME),
        stands("link_kill"),
        stands("link_stop", on=("quadruped", "drone"), elsewhere=_SAME),
        stands("link_drop"),
        Row("robot_frozen", "stands", 4.0, ANY, {"drone": 5.0}, "2 s frozen, and braking", **at),
        stands("takeover", lands=False),
        stands("suspend"),
    )


def _disengaging() -> tuple[Row, ...]:
    at = {"phase": TrialPhase.DISENGAGING, "after_s": 0.0}
    told = partial(Row, measure="told", limit_s=0.0, endings=ANY, **at)
    return (
        *(
            _signal(name, "told", 0.0, trials=2, phase=TrialPhase.DISENGAGING, **more)
            for name, more in (
                ("interrupt", {}),
                ("terminate", {"on": ("wheeled",), "elsewhere": _HANDLER}),
                ("hangup", {"on": ("quadruped",), "elsewhere": _HANDLER}),
            )
        ),
        told("tracker_kill"),
        told("tracker_stop", on=("drone",), elsewhere=_SAME),
        told("link_kill"),
        told("link_stop", on=("drone",), elsewhere=_SAME),
        told("link_drop", on=("drone", "wheeled"), elsewhere="it stands and is told nothing any more"),
        told("robot_frozen", on=("drone",), elsewhere="it stands already"),
        told("takeover", lands=False),
        told("suspend", on=("drone",), elsewhere=_SAME),
    )


def _between() -> tuple[Row, ...]:
    at = {"phase": TrialPhase.BETWEEN, "after_s": 0.0, "trials": 2}
    signal = partial(_signal, measure="told", limit_s=0.0, endings=INTERRUPTED | WENT_ON | KILLED)
    return (
        signal("interrupt", phase=TrialPhase.BETWEEN, trials=2),
        signal("terminate", phase=TrialPhase.BETWEEN, trials=2, on=("wheeled",), elsewhere=_HANDLER),
        signal("hangup", phase=TrialPhase.BETWEEN, trials=2, on=("quadruped",), elsewhere=_HANDLER),
        Row("tracker_kill", "told", 0.0, KILLED, ends_run=True, elsewhere=_SAME, **{**at, "on": ("drone",)}),
    )


PHASE_ROWS = tuple(
    with_words(row)
    for rows in (
        _connecting(),
        _engaging(),
        _take_off(TrialPhase.ARMED),
        _take_off(TrialPhase.CLIMBING),
        _looking(),
        _stopping(),
        _disengaging(),
        _between(),
    )
    for row in rows
)
"""What is struck in another phase than following."""

PHASE_FAULTS = (
    *("interrupt", "terminate", "hangup", "tracker_kill", "tracker_stop", "link_kill", "link_stop"),
    *("link_drop", "robot_frozen", "takeover", "camera_gone", "suspend"),
)
"""The faults of the table by phase."""

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
    """Tell whether a robot's trials have a phase: a drone's engaging is two, which others have not."""
    return flies if phase in IN_FLIGHT else not (flies and phase is TrialPhase.ENGAGING)


def all_rows(platform: str, *, flies: bool) -> tuple[Row, ...]:
    """Return the rows of one robot, in the order of a trial's phases."""
    rows = [row for row in (*ROWS, *PHASE_ROWS) if has_phase(row.phase, flies=flies)]
    shown = [row for row in rows if not row.on or platform in row.on]
    return tuple(sorted(shown, key=lambda row: ORDER.index(row.phase)))


def absent_in_phase(platform: str, fault: str, phase: TrialPhase, *, flies: bool) -> str:
    """Return why a cell of the table by phase has no row; empty where it has one, or needs none."""
    rows = [row for row in PHASE_ROWS if (row.fault, row.phase) == (fault, phase)]
    if not has_phase(phase, flies=flies) or any(not row.on or platform in row.on for row in rows):
        return ""
    return next((row.elsewhere for row in rows if row.elsewhere), "") or _NO_ROW.get((fault, phase), "")
