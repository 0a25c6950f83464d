"""Kaplan-Meier survival curve: how long trials last when some outlast the horizon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


@dataclass(frozen=True, slots=True)
class Fall:
    """One step down of the curve."""

    at: float
    """Steps, or whatever the durations are in."""
    at_risk: int
    """Trials that lasted as long, this one's failures among them."""
    failed: int
    """Trials that failed here; at least one."""
    survival: float
    """Share estimated to last longer than that; in [0, 1]."""


def kaplan_meier(durations: Sequence[float], failed: Sequence[bool]) -> tuple[Fall, ...]:
    """Return where the survival curve falls, in order; before the first it is 1, after each it stays.

    A trial that reached its horizon is censored: that it lasted so long is known, how long it would have
    gone on is not. It counts as at risk up to and with its own end.

    Source: E. L. Kaplan and P. Meier, "Nonparametric estimation from incomplete observations", 1958.

    Args:
        durations: one a trial.
        failed: whether it ended there by failing; otherwise it was censored.

    Raises:
        ValueError: they are not as many.
    """
    falls: list[Fall] = []
    survival = 1.0
    ends = list(zip(durations, failed, strict=True))
    for at in sorted({duration for duration, fails in ends if fails}):
        at_risk = sum(duration >= at for duration, _ in ends)
        failures = sum(fails and duration == at for duration, fails in ends)
        survival *= 1 - failures / at_risk
        falls.append(Fall(at, at_risk, failures, survival))
    return tuple(falls)


def median_duration(falls: Sequence[Fall]) -> float | None:
    """Return when the curve reaches one half, or None where it never does: most trials were censored."""
    return next((fall.at for fall in falls if fall.survival <= 0.5), None)
