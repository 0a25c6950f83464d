"""Compares a row's evidence with its limits. Pure: evidence in, a verdict out.

A verdict is never vacuous: the fault must have taken effect in its phase, the robot must have moved if it
should, and the run must have ended for the expected reason.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

from adatracker_deploy.faults.evidence import Evidence, without_effect
from adatracker_deploy.faults.matrix import SLOT_S
from adatracker_deploy.faults.phases import TrialPhase

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from adatracker_deploy.faults.matrix import Measure, Row
    from adatracker_deploy.sim.ground_truth import Account, Told

__all__ = ["Evidence", "Result", "Verdict", "judge", "limit_of"]

MOVING_M_S = 0.3
"""Speed above which a robot counts as moving, flying or not, so that its stop means something."""
STILL_M_S = {True: 0.3, False: 0.05}
"""Speed below which a robot counts as standing, by whether it flies: a drone hovering in wind is never quite
still."""
CLIMBS_M_S = 0.2
"""Climb rate that neither wind nor an estimation error explains."""
LANDED_M = 0.2
AWAKE_S = 0.2
"""A command that arrives this long after the processes were stopped was sent by one that has woken."""
JITTER_S = 0.05
"""Largest change of the interval between two commands in transit."""
GAPS_S = 0.5
"""Time before and after the onset in which gaps between commands are checked."""

Verdict = Literal["ok", "LATE", "WRONG", "not shown"]
_STOPS: frozenset[Measure] = frozenset({"told", "latched", "stands", "quiet", "woken", "climbs"})
"""Measures that are upper limits on a time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """The result of one row."""

    platform: str
    fault: str
    says: str
    limit: str
    """The limit, in a few words."""
    phase: str = TrialPhase.FOLLOWING
    variant: str = ""
    why: str = ""
    """The derivation of the limit, if it is not a round number."""
    value_s: float | None = None
    """The measured value that the limit applies to."""
    told_s: float | None = None
    """From the onset until the last command that moves the robot."""
    latched_s: float | None = None
    stands_s: float | None = None
    """From the onset until the robot has come to rest by its true speed."""
    onset_m_s: float | None = None
    """The robot's true speed at the onset."""
    stall_s: float = 0.0
    """The machine's own longest stall around the onset."""
    outcome: str = ""
    reason: str = ""
    """The run's own reason for its end."""
    noticed: str = ""
    """The first to notice: tracker, link or robot."""
    again: str = ""
    """Result of an immediate second run with the same robot; empty without one."""
    verdict: Verdict = "not shown"
    note: str = ""
    tries: int = 1
    first_failure: str = ""
    """The failure of the first attempt, if the row was run again."""

    @property
    def name(self) -> str:
        """The row's name, as for ``--fault`` of the matrix."""
        of_phase = "" if self.phase == TrialPhase.FOLLOWING else f"@{self.phase}{self.variant}"
        return f"{self.fault}{of_phase}"


def judge(
    row: Row, platform: str, says: str, evidence: Evidence, *, flies: bool, accel_m_s2: float
) -> Result:
    """Judge a row's evidence.

    Args:
        row: the row with its limits.
        platform: the robot's platform.
        says: what happened, in words for people.
        evidence: the row's.
        flies: whether the robot flies: it hovers where others stand, and lands before the command ends.
        accel_m_s2: the largest acceleration that the profile allows.
    """
    account, limit_s = evidence.account, row.limit_of(platform)
    onset_ns = account.onset_ns(row.fault)
    result = Result(
        platform=platform,
        fault=row.fault,
        phase=row.phase,
        variant=row.variant,
        says=says,
        limit=limit_of(row, platform),
        why=row.why,
        outcome=evidence.outcome or "killed",
        reason=evidence.reason,
        noticed=evidence.noticed,
        verdict="WRONG",
    )
    if onset_ns is None:
        return replace(result, note=f"it ended before: {evidence.reason or evidence.outcome or 'no word'}")
    told_s = _since(onset_ns, (told.t_ns for told in account.commands if told.moves))
    stands_s = _since(onset_ns, (t_ns for t_ns, speed in account.speeds if speed > STILL_M_S[flies]))
    measures: dict[Measure, Callable[[], tuple[float | None, str]]] = {
        "told": lambda: (told_s, ""),
        "stands": lambda: (stands_s, ""),
        "latched": lambda: (evidence.latched_s, ""),
        "quiet": lambda: (_quiet(account, row.fault, onset_ns), ""),
        "woken": lambda: (_woken(evidence, onset_ns), ""),
        "climbs": lambda: (_climbs(account, onset_ns), ""),
        "log": lambda: (0.0 if evidence.log_trouble else None, "" if evidence.log_trouble else "untold"),
        "gap": lambda: _gap(account.commands, onset_ns),
        "burst": lambda: _burst(evidence, onset_ns),
        "acceleration": lambda: (round(_acceleration(account.commands, onset_ns) / accel_m_s2, 2), ""),
    }
    value_s, note = measures[row.measure]()
    stops = row.measure in _STOPS
    result = replace(
        result,
        value_s=value_s,
        told_s=told_s if stops else None,
        latched_s=evidence.latched_s if stops else None,
        stands_s=stands_s if stops else None,
        onset_m_s=account.speed_at(onset_ns),
        note=_shows_nothing(row, evidence, onset_ns)
        or _not_as_it_should(row, evidence, onset_ns, flies=flies),
    )
    if result.note:
        return result
    if evidence.exit_s > row.exit_s and not flies:
        return replace(result, verdict="LATE", note=f"the command ended after {evidence.exit_s:.1f} s")
    fits = value_s is not None and (value_s >= limit_s if row.measure == "burst" else value_s <= limit_s)
    return replace(result, verdict="ok" if fits else "LATE" if stops else "WRONG", note=note)


def _shows_nothing(row: Row, evidence: Evidence, onset_ns: int) -> str:
    """Return why the evidence is vacuous; empty if it shows the row's fault, in its phase, at speed."""
    phase = evidence.account.phase_at(onset_ns)
    if phase != row.phase:
        return f"it struck while {phase or 'nothing was on'}"
    speed_m_s = evidence.account.speed_at(onset_ns)
    if row.moves and speed_m_s < MOVING_M_S:
        return f"the robot was not moving at the onset: {speed_m_s:.2f} m/s"
    return without_effect(row.fault, evidence, onset_ns)


def _not_as_it_should(row: Row, evidence: Evidence, onset_ns: int, *, flies: bool) -> str:
    """Return what went wrong besides lateness; empty if nothing did."""
    account, reason = evidence.account, evidence.reason
    engaged = any(began_ns > onset_ns for began_ns, phase in account.phases if phase == TrialPhase.ENGAGING)
    offboard_s = _offboard_after_s(account, onset_ns) if flies and row.stops else None
    allowed_s = row.limit_s if row.measure == "climbs" else 0.0
    height_m = account.flight[-1].height_m if account.flight else 0.0
    found = (
        (evidence.outcome not in row.endings, f"ended as {evidence.outcome or 'nothing'}: {reason}"),
        (not re.search(row.words, reason, re.IGNORECASE), f"another reason was given: {reason or 'none'}"),
        (row.ends_run and engaged, "another trial was engaged after it"),
        ((offboard_s or 0.0) > allowed_s, f"OFFBOARD {offboard_s or 0:.1f} s after it"),
        (row.lands and not account.off, "the robot was not seen to come to rest"),
        (row.lands and height_m > LANDED_M, f"not landed: {height_m:.1f} m high"),
        (row.measure != "log" and not evidence.log_whole, "the log is incomplete"),
    )
    return next((words for is_so, words in found if is_so), "")


def _offboard_after_s(account: Account, onset_ns: int) -> float | None:
    """Return when a drone last entered OFFBOARD after an onset, s; None if it did not.

    PX4 returns to it once it has landed and disarmed; that does not count.
    """
    entered = [t for t, mode, armed in account.modes if mode == "OFFBOARD" and armed and t > onset_ns]
    return (entered[-1] - onset_ns) / 1e9 if entered else None


def _quiet(account: Account, fault: str, onset_ns: int) -> float:
    over_ns = account.over_ns(fault) or math.inf
    return _since(onset_ns, (told.t_ns for told in account.commands if told.moves and told.t_ns < over_ns))


def _woken(evidence: Evidence, onset_ns: int) -> float | None:
    """Return the time from waking to the last motion command, s; None if no process was seen stopped."""
    stopped_ns = evidence.seen.first("link", "stopped", onset_ns, onset_ns + 2_000_000_000)
    if stopped_ns is None:
        return None
    awake_ns = stopped_ns + round(AWAKE_S * 1e9)
    return _since(awake_ns, (told.t_ns for told in evidence.account.commands if told.moves))


def _climbs(account: Account, onset_ns: int) -> float:
    """Return when a drone last climbed, s after the onset; a bounce at touch-down does not count."""
    climbs = (each for each in account.flight if each.up_m_s > CLIMBS_M_S and each.height_m > LANDED_M)
    return _since(onset_ns, (each.t_ns for each in climbs))


def _gap(commands: tuple[Told, ...], onset_ns: int) -> tuple[float, str]:
    """Return the gate's largest delay, s."""
    gaps_s = [
        ((later.t_ns - onset_ns) / 1e9, (later.t_ns - earlier.t_ns) / 1e9)
        for earlier, later in pairwise(commands)
    ]
    before_s, gap_s = (
        max((gap_s for over_s, gap_s in gaps_s if since_s < over_s <= until_s), default=math.inf)
        for since_s, until_s in ((-GAPS_S, 0.0), (0.0, GAPS_S))
    )
    return gap_s - SLOT_S, f"commands at most {gap_s * 1e3:.0f} ms apart, {before_s * 1e3:.0f} ms before it"


def _burst(evidence: Evidence, onset_ns: int) -> tuple[float | None, str]:
    """Return the smallest gap between two ticks as a share of the period."""
    times_ns = [tick.t_ns for tick in evidence.ticks if tick.t_ns > onset_ns]
    gaps_s = [(later - earlier) / 1e9 for earlier, later in pairwise(times_ns)]
    if not gaps_s:
        return None, "no tick followed"
    period_s = sorted(gaps_s)[len(gaps_s) // 2]
    missed = round(sum(gaps_s) / period_s) - len(gaps_s)
    return round(min(gaps_s) / period_s, 2), f"slots missed: {missed}"


def _acceleration(commands: tuple[Told, ...], onset_ns: int) -> float:
    """Return the largest forward acceleration, m/s^2, beyond jitter; stops to zero are left out.

    Commands that arrive together left one slot apart: a busy host delivers them late, not a gate too fast.
    """
    near = [told for told in commands if 0 <= told.t_ns - onset_ns < 2e9]
    largest = 0.0
    for first, earlier in enumerate(near):
        for slots, later in enumerate(near[first + 1 : first + 30], start=1):
            if not later.moves:
                break
            seconds = max((later.t_ns - earlier.t_ns) / 1e9, slots * SLOT_S) + JITTER_S
            largest = max(largest, abs(later.vx - earlier.vx) / seconds)
    return largest


def _since(onset_ns: int, times_ns: Iterable[int]) -> float:
    """Return the seconds from the onset to the last of these times; 0 if all are before."""
    return max(0.0, (max(times_ns, default=onset_ns) - onset_ns) / 1e9)


def limit_of(row: Row, platform: str) -> str:
    """Return a platform's limit in a few words."""
    return _GOES_ON.get(row.measure, f"{row.measure} {row.limit_of(platform):g} s")


_GOES_ON: dict[Measure, str] = {
    "gap": "gate 10 ms",
    "burst": "no burst",
    "acceleration": "accelerates",
    "log": "goes on",
}
"""Texts of the limits of rows in which the robot goes on."""
