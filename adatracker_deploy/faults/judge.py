"""Compares what happened with what is allowed. Pure: evidence in, a verdict out."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

from adatracker_deploy.faults.matrix import SLOT_S

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from adatracker_deploy.faults.matrix import Measure, Row
    from adatracker_deploy.faults.witness import Account, Told

MOVED_S = 0.1
"""A robot that was not told to move for so long before the onset stood already: that shows nothing."""
STILL_M_S = {True: 0.3, False: 0.05}
"""Slower than this a robot stands, by whether it flies: a drone that hovers in wind is never quite still."""
JITTER_S = 0.05
"""By how much two commands may be further apart, or nearer, than they were sent."""
GAPS_S = 0.5
"""Before and after the onset, in which gaps between commands are looked at."""

Verdict = Literal["ok", "LATE", "WRONG", "not shown"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """What a row left."""

    account: Account
    status: int | None
    """The command's exit status; None when it had to be killed."""
    outcome: str
    """Of the trial; empty when it could not say."""
    reason: str = ""
    latched_s: float | None = None
    """From the onset until the link's stop, by its own clock; None when it latched none."""
    tick_gaps_s: tuple[float, ...] = ()
    """Between the loop's ticks, from the onset on."""
    log_trouble: bool = False
    """The run said that its log is not whole."""
    log_whole: bool = True
    """It is: the log has its end."""
    exit_s: float = 0.0
    """From the onset until the command had ended."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """A row's answer."""

    platform: str
    fault: str
    says: str
    limit: str
    """What is allowed, in few words."""
    why: str = ""
    """What the limit is made of, where it is no round promise."""
    value_s: float | None = None
    """What the limit is of."""
    told_s: float | None = None
    """From the onset until the last command that moves the robot."""
    latched_s: float | None = None
    stands_s: float | None = None
    """From the onset until the robot's true speed has fallen for good."""
    stall_s: float = 0.0
    """The machine's own longest stall about the onset."""
    outcome: str = ""
    verdict: Verdict = "not shown"
    note: str = ""
    tries: int = 1


def judge(
    row: Row, platform: str, says: str, evidence: Evidence, *, flies: bool, accel_m_s2: float
) -> Result:
    """Return what a row's evidence amounts to.

    Args:
        row: what is allowed.
        platform: whose evidence it is.
        says: what happened, for people.
        evidence: of the row.
        flies: the robot does: it hovers where others stand, and lands before the command ends.
        accel_m_s2: the largest acceleration that the profile allows.
    """
    limit_s, onset_ns = row.limit_of(platform), evidence.account.onset_ns(row.fault)
    result = Result(
        platform=platform,
        fault=row.fault,
        says=says,
        limit=_limit(row, limit_s),
        why=row.why,
        outcome=evidence.outcome or "killed",
        verdict="WRONG",
        note=_shows_nothing(row, evidence, onset_ns),
    )
    if onset_ns is None:
        return result
    commands, speeds = evidence.account.commands, evidence.account.speeds
    told_s = _since(onset_ns, (told.t_ns for told in commands if told.moves))
    stands_s = _since(onset_ns, (t_ns for t_ns, speed in speeds if speed > STILL_M_S[flies]))
    measures: dict[Measure, Callable[[], tuple[float | None, str]]] = {
        "told": lambda: (told_s, ""),
        "stands": lambda: (stands_s, ""),
        "latched": lambda: (evidence.latched_s, ""),
        "log": lambda: (0.0 if evidence.log_trouble else None, "" if evidence.log_trouble else "untold"),
        "gap": lambda: _gap(commands, onset_ns),
        "burst": lambda: _burst(evidence.tick_gaps_s),
        "acceleration": lambda: (round(_acceleration(commands, onset_ns) / accel_m_s2, 2), ""),
    }
    value_s, note = measures[row.measure]()
    stops = row.measure in ("told", "latched", "stands")
    result = replace(
        result,
        value_s=value_s,
        told_s=told_s if stops else None,
        latched_s=evidence.latched_s if stops else None,
        stands_s=stands_s if stops else None,
    )
    if result.note:
        return result
    if evidence.exit_s > row.exit_s and not flies:
        return replace(result, verdict="LATE", note=f"the command ended after {evidence.exit_s:.1f} s")
    fits = value_s is not None and (value_s >= limit_s if row.measure == "burst" else value_s <= limit_s)
    return replace(result, verdict="ok" if fits else "LATE" if stops else "WRONG", note=note)


def _shows_nothing(row: Row, evidence: Evidence, onset_ns: int | None) -> str:
    """Say why the evidence shows nothing, or something else; empty when it is of a stop like the row's."""
    if onset_ns is None:
        return f"it ended before: {evidence.reason or evidence.outcome or 'no word'}"
    if not _moved(evidence.account.commands, onset_ns):
        return "the robot was not moving at the onset"
    if evidence.outcome not in row.endings:
        return f"ended as {evidence.outcome or 'nothing'}: {evidence.reason}"
    if not evidence.account.off:
        return "the robot was not seen to come to rest"
    if row.measure != "log" and not evidence.log_whole:
        return "the log is not whole"
    return ""


def _gap(commands: tuple[Told, ...], onset_ns: int) -> tuple[float, str]:
    """Return by how much the gate was late at the worst, s."""
    gaps_s = [
        ((later.t_ns - onset_ns) / 1e9, (later.t_ns - earlier.t_ns) / 1e9)
        for earlier, later in pairwise(commands)
    ]
    before_s, gap_s = (
        max((gap_s for over_s, gap_s in gaps_s if since_s < over_s <= until_s), default=math.inf)
        for since_s, until_s in ((-GAPS_S, 0.0), (0.0, GAPS_S))
    )
    return gap_s - SLOT_S, f"commands at most {gap_s * 1e3:.0f} ms apart, {before_s * 1e3:.0f} ms before it"


def _burst(gaps_s: tuple[float, ...]) -> tuple[float | None, str]:
    """Return the smallest gap between two ticks as a share of the period."""
    if not gaps_s:
        return None, "no tick followed"
    period_s = sorted(gaps_s)[len(gaps_s) // 2]
    missed = round(sum(gaps_s) / period_s) - len(gaps_s)
    return round(min(gaps_s) / period_s, 2), f"slots missed: {missed}"


def _acceleration(commands: tuple[Told, ...], onset_ns: int) -> float:
    """Return the largest change of forward speed per second, m/s^2, that cannot be jitter, braking to zero
    at once left out.
    """
    near = [told for told in commands if 0 <= told.t_ns - onset_ns < 2e9]
    largest = 0.0
    for first, earlier in enumerate(near):
        for later in near[first + 1 : first + 30]:
            if not later.moves:
                break
            seconds = (later.t_ns - earlier.t_ns) / 1e9 + JITTER_S
            largest = max(largest, abs(later.vx - earlier.vx) / seconds)
    return largest


def _moved(commands: tuple[Told, ...], onset_ns: int) -> bool:
    return any(told.moves and 0 <= onset_ns - told.t_ns < MOVED_S * 1e9 for told in commands)


def _since(onset_ns: int, times_ns: Iterable[int]) -> float:
    """Return the seconds from the onset to the last of these times; 0 if all are before."""
    return max(0.0, (max(times_ns, default=onset_ns) - onset_ns) / 1e9)


def _limit(row: Row, limit_s: float) -> str:
    """Say what is allowed, in few words."""
    match row.measure:
        case "told" | "latched" | "stands":
            return f"{row.measure} {limit_s:g} s"
        case "gap":
            return "gate 10 ms"
        case "burst":
            return "no burst"
        case "acceleration":
            return "accelerates"
        case "log":
            return "goes on"
