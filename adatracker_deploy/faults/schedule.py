"""Parses, checks and sorts a schedule of faults such as ``camera_freeze@5,interrupt@climbing``. Pure."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.faults.phases import IN_FLIGHT, ORDER, TrialPhase

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from adatracker_deploy.core.faults import Fault

LATEST_S = 3600.0
_SECONDS = r"\d{1,5}(?:\.\d{1,3})?"
_STRIKE = re.compile(rf"([A-Za-z_0-9]+)@(?:({_SECONDS})|([a-z]+)(?:\+({_SECONDS}))?)", re.ASCII)


@dataclass(frozen=True, slots=True)
class ScheduledFault:
    """One fault at a given time."""

    fault: Fault
    at_s: float = 0.0
    """Machine time after its phase has begun; FOLLOWING begins with the first followed tick."""
    phase: TrialPhase = TrialPhase.FOLLOWING

    @property
    def over_s(self) -> float:
        """End of the fault, s after its phase has begun; `at_s` for a single event or a permanent fault."""
        return self.at_s + self.fault.lasts_s

    def __str__(self) -> str:
        """Return it in the syntax of ``--fault``."""
        if self.phase is TrialPhase.FOLLOWING:
            return f"{self.fault.name}@{self.at_s:g}"
        return f"{self.fault.name}@{self.phase}" + (f"+{self.at_s:g}" if self.at_s else "")


def parse_schedule(
    texts: Iterable[str], known: Mapping[str, Fault], *, flies: bool = False
) -> tuple[ScheduledFault, ...]:
    """Parse the arguments of ``--fault``; return the faults in the order of a trial.

    Args:
        texts: each ``NAME@SECONDS`` after the first followed tick, ``NAME@PHASE`` or ``NAME@PHASE+SECONDS``,
            or several with commas between them.
        known: the faults that this rehearsal supports, by name.
        flies: whether the robot flies, and so has the phases of a climb.

    Raises:
        UsageError: a text is malformed, a fault or phase is unknown here, or a fault begins while it is
            active.
    """
    phases = [phase for phase in ORDER if flies or phase not in IN_FLIGHT]
    strikes = sorted(
        (_strike(part.strip(), known, phases) for text in texts for part in text.split(",")),
        key=lambda strike: (ORDER.index(strike.phase), strike.at_s),
    )
    ends: dict[tuple[str, TrialPhase], float] = {}
    for strike in strikes:
        key = strike.fault.name, strike.phase
        if strike.at_s <= ends.get(key, -1.0):
            raise UsageError(f"--fault {strike}: it lasts until {ends[key]:g} s from before")
        ends[key] = strike.over_s if strike.fault.lasts_s else LATEST_S
    return tuple(strikes)


def next_due(
    strikes: Iterable[ScheduledFault], entered: Mapping[TrialPhase, float]
) -> tuple[float, ScheduledFault] | None:
    """Return the next scheduled fault, and when it is due; None while none is.

    Args:
        strikes: those that have not begun.
        entered: when each phase was entered, s.
    """
    due = ((entered[strike.phase] + strike.at_s, strike) for strike in strikes if strike.phase in entered)
    return min(due, key=lambda pair: pair[0], default=None)


def _strike(text: str, known: Mapping[str, Fault], phases: list[TrialPhase]) -> ScheduledFault:
    match = _STRIKE.fullmatch(text)
    if match is None:
        raise UsageError(
            f"--fault {text!r}: expected NAME@SECONDS, NAME@PHASE or NAME@PHASE+SECONDS, for example "
            f"{next(iter(known))}@5"
        )
    name, seconds, phase, after = match.groups()
    fault, at_s = known.get(name), float(seconds or after or 0)
    if fault is None:
        raise UsageError(f"--fault {text}: unknown for this rehearsal; known are {', '.join(known)}")
    if phase is not None and phase not in phases:
        raise UsageError(f"--fault {text}: this robot's phases are {', '.join(phases)}")
    if at_s > LATEST_S:
        raise UsageError(f"--fault {text}: {at_s:g} s is out of range [0, {LATEST_S:g}]")
    return ScheduledFault(fault, at_s, TrialPhase(phase) if phase else TrialPhase.FOLLOWING)
