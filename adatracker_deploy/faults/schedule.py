"""What is to go wrong when: ``camera_freeze@5,link_drop@8``, read, checked and put in order. Pure."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from adatracker_deploy.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from adatracker_deploy.faults.catalogue import Fault

LATEST_S = 3600.0
_STRIKE = re.compile(r"([A-Za-z_0-9]+)@(\d{1,5}(?:\.\d{1,3})?)", re.ASCII)


@dataclass(frozen=True, slots=True)
class Strike:
    """One fault at one time."""

    fault: Fault
    at_s: float
    """Machine time after the first followed tick."""

    @property
    def over_s(self) -> float:
        """When it is over, s after the first followed tick; `at_s` for what happens once, or stays."""
        return self.at_s + self.fault.lasts_s


@dataclass(frozen=True, slots=True)
class Moment:
    """A fault begins, or ends."""

    at_s: float
    fault: Fault
    begins: bool


def parse_schedule(texts: Iterable[str], known: Mapping[str, Fault]) -> tuple[Strike, ...]:
    """Read what ``--fault`` was given, several in one text or in many; return it sorted by time.

    Args:
        texts: each ``NAME@SECONDS``, or several with commas between them.
        known: what can be injected into this rehearsal, by name.

    Raises:
        UsageError: a text is none, a fault is unknown here, or begins while it lasts.
    """
    strikes = sorted(
        (_strike(part.strip(), known) for text in texts for part in text.split(",")),
        key=lambda strike: strike.at_s,
    )
    ends: dict[str, float] = {}
    for strike in strikes:
        name = strike.fault.name
        if strike.at_s <= ends.get(name, -1.0):
            raise UsageError(f"--fault {name}@{strike.at_s:g}: it lasts until {ends[name]:g} s from before")
        ends[name] = strike.over_s if strike.fault.lasts_s else LATEST_S
    return tuple(strikes)


def timeline(strikes: Iterable[Strike]) -> tuple[Moment, ...]:
    """Return all beginnings and ends in the order of their times, an end before a beginning."""
    moments = [Moment(strike.at_s, strike.fault, begins=True) for strike in strikes]
    moments += [
        Moment(strike.over_s, strike.fault, begins=False) for strike in strikes if strike.fault.lasts_s
    ]
    return tuple(sorted(moments, key=lambda moment: (moment.at_s, moment.begins)))


def _strike(text: str, known: Mapping[str, Fault]) -> Strike:
    match = _STRIKE.fullmatch(text)
    if match is None:
        raise UsageError(f"--fault {text!r}: expected NAME@SECONDS, for example {next(iter(known))}@5")
    fault, at_s = known.get(match[1]), float(match[2])
    if fault is None:
        raise UsageError(f"--fault {text}: unknown for this rehearsal; known are {', '.join(known)}")
    if at_s > LATEST_S:
        raise UsageError(f"--fault {text}: {at_s:g} s is out of range [0, {LATEST_S:g}]")
    return Strike(fault, at_s)
