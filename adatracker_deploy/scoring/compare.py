"""Compares two sets of trials: differences with intervals, exact tests, and conclusions in words.

Where every trial of one set has its partner in the other (the same rehearsal, or the same turn if it was
planned so), differences are taken pair by pair, which takes the ease of the course out of them.
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.scoring.stats.exact import Test, fisher, permutation, sign_flip
from adatracker_deploy.scoring.stats.intervals import (
    Estimate,
    mean_difference,
    mean_estimate,
    share_difference,
)
from adatracker_deploy.scoring.summary import columns_of, counted

if TYPE_CHECKING:
    from collections.abc import Hashable, Sequence

    from adatracker_deploy.scoring.tally import Summary

Pairing = Literal["auto", "order", "none"]
RATE_TOLERANCE = 0.1
"""Rates that differ by less, relative to the slower, are the same: a busy robot misses some slots."""
DIGITS = {"mr": 2, "el": 0, "sr": 2, "ar": 0}
_TESTS = {
    "fisher": "Fisher's exact test",
    "permutation": "permutation test",
    "sign_flip": "sign-flip test of pairs",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """The difference of B's mean from A's in one metric."""

    metric: str
    """mr, el, sr or ar."""
    unit: str
    """steps or s for el, empty for the others."""
    means: tuple[float, float]
    """A's and B's."""
    estimate: Estimate
    """B less A: Student's interval of pairs, else Welch's; for SR Newcombe's."""
    test: Test
    method: str
    """fisher, permutation or sign_flip."""
    counts: tuple[int, int]
    """Trials of A and of B."""

    @property
    def words(self) -> str:
        """The conclusion, in a sentence."""
        name, digits = self.metric.upper(), 1 if self.unit == "s" else DIGITS[self.metric]
        p = f"p = {self.test.p:.2g}, {'' if self.test.exact else 'sampled '}{_TESTS[self.method]}"
        n = str(self.counts[0]) if len(set(self.counts)) == 1 else f"{self.counts[0]} and {self.counts[1]}"
        unit = f" {self.unit}" if self.unit else ""
        if self.test.separates:
            more = "higher" if self.estimate.value > 0 else "lower"
            return f"{name}: B's is {more} by {abs(self.estimate.value):.{digits}f}{unit} ({p})"
        if self.test.least >= 0.05:
            floor = f"so few trials cannot give p < {self.test.least:.2g}, whatever they show"
            return f"{name}: not separable at n = {n} ({p}); {floor}"
        low, high = self.estimate.bounds
        if self.estimate.value == 0 and low == high:
            return f"{name}: not separable at n = {n} ({p}); every trial came out the same"
        span = (
            "" if low is None else f"; the difference may be {low:+z.{digits}f} to {high:+z.{digits}f}{unit}"
        )
        return f"{name}: not separable at n = {n} ({p}){span}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """B against A."""

    differences: tuple[Difference, ...]
    paired: bool
    notes: tuple[str, ...]
    """Caveats for the reader."""


def compare(
    ours: Sequence[Summary],
    theirs: Sequence[Summary],
    *,
    pairing: Pairing = "auto",
) -> Comparison:
    """Compare two sets of scored trials, A and B, as far as they are `counted`; differences are B less A.

    Where the trials' rates differ, EL is compared in seconds, and AR, a sum over steps, not at all.

    Args:
        ours: A, at least one.
        theirs: B, at least one.
        pairing: by equal rehearsals if every trial has its partner (auto), by order, or none.

    Raises:
        UsageError: the rates differ and a trial's is not known; pairs by order are wanted of unequal sets;
            no trial of A or of B counts.
    """
    left_out = len(ours) + len(theirs)
    ours, theirs, pairs = _counted(ours, theirs, _pairs(ours, theirs, pairing))
    left_out -= len(ours) + len(theirs)
    different = _rates_differ([*ours, *theirs])
    first, second = _columns(ours, in_seconds=bool(different)), _columns(theirs, in_seconds=bool(different))
    counts = (len(ours), len(theirs))
    found = []
    for metric in ("mr", "el", "sr") if different else ("mr", "el", "sr", "ar"):
        if metric not in first or metric not in second:
            continue
        a, b = first[metric], second[metric]
        means = (statistics.fmean(a), statistics.fmean(b))
        if metric == "sr":
            hits = (round(sum(b)), counts[1], round(sum(a)), counts[0])
            estimate, test, method = share_difference(*hits), fisher(*hits), "fisher"
        elif pairs is not None:
            less = [b[partner] - a[index] for index, partner in enumerate(pairs)]
            estimate, test, method = mean_estimate(less), sign_flip(less), "sign_flip"
        else:
            estimate, test, method = mean_difference(b, a), permutation(b, a), "permutation"
        unit = ("s" if different else "steps") if metric == "el" else ""
        found.append(
            Difference(
                metric=metric,
                unit=unit,
                means=means,
                estimate=estimate,
                test=test,
                method=method,
                counts=counts,
            )
        )
    notes = _notes(ours, theirs, different)
    if left_out:
        notes = (f"{left_out} trials are left out, whose timing was not kept or whose pair's was not", *notes)
    return Comparison(differences=tuple(found), paired=pairs is not None, notes=notes)


def _rates_differ(summaries: Sequence[Summary]) -> str:
    """Say which rates there are; nothing if they are alike, or unknown altogether."""
    rates = [row.get("rate_hz") for row in summaries if row["el"]]
    known = [rate for rate in rates if rate]
    if not known:
        return ""
    if len(known) < len(rates):
        return f"{min(known):.1f} Hz and unknown: give it with --rate HZ"
    slow, fast = min(known), max(known)
    return f"{slow:.1f} to {fast:.1f} Hz" if fast > slow * (1 + RATE_TOLERANCE) else ""


def _columns(summaries: Sequence[Summary], *, in_seconds: bool) -> dict[str, list[float]]:
    columns = columns_of(summaries)
    if in_seconds:
        unknown = [row["trial"] for row in summaries if row["el"] and row.get("seconds") is None]
        if unknown:
            raise UsageError(
                f"{unknown[0]}: its rate is not known, so EL has no seconds: give it with --rate HZ"
            )
        columns["el"] = [row.get("seconds") or 0.0 for row in summaries]
    return columns


def _counted(
    ours: Sequence[Summary], theirs: Sequence[Summary], pairs: Sequence[int] | None
) -> tuple[Sequence[Summary], Sequence[Summary], Sequence[int] | None]:
    """Return the trials that count, of pairs those of which both do, and the pairs among them.

    Raises:
        UsageError: none is left.
    """
    if pairs is None:
        kept: tuple[Sequence[Summary], ...] = (counted(ours), counted(theirs))
    else:
        both = [(row, theirs[place]) for row, place in zip(ours, pairs, strict=True)]
        both = [pair for pair in both if len(counted(pair)) == 2]
        kept = ([row for row, _ in both], [row for _, row in both])
        pairs = range(len(both))
    for name, rows in zip(("A", "B"), kept, strict=True):
        if not rows:
            raise UsageError(f"{name}: no trial kept its timing, so there is nothing to compare; --all does")
    return kept[0], kept[1], pairs


def _pairs(ours: Sequence[Summary], theirs: Sequence[Summary], pairing: Pairing) -> list[int] | None:
    """Return for every trial of A the index of its partner in B, or None where they are not paired."""
    if pairing == "none":
        return None
    if pairing == "order":
        if len(ours) != len(theirs):
            raise UsageError(f"--pairs order: A has {len(ours)} trials, B {len(theirs)}: they make no pairs")
        return list(range(len(ours)))
    partners = {key: index for index, row in enumerate(theirs) if (key := _episode(row)) is not None}
    keys = [_episode(row) for row in ours]
    if len(set(keys)) < len(keys) or len(keys) != len(theirs) or set(keys) != set(partners):
        return None
    return [partners[key] for key in keys]


def _episode(row: Summary) -> Hashable | None:
    """The random draw of a rehearsal, by which its partner is found; None for everything else."""
    if not row.get("episode"):
        return None
    return (
        row["platform"],
        row["steps"],
        *sorted((key, str(value)) for key, value in row["episode"].items()),
    )


def _notes(ours: Sequence[Summary], theirs: Sequence[Summary], different: str) -> tuple[str, ...]:
    notes = []
    if different:
        notes.append(
            f"the trials ran at different rates ({different}): EL is compared in seconds, AR is not. "
            "At half the rate so many lost steps are twice as long, and so is a horizon of as many steps: EL "
            "and SR are like for like only with horizons of equal seconds"
        )
    horizons = sorted({row["steps"] for row in (*ours, *theirs)})
    if len(horizons) > 1:
        notes.append(
            f"planned horizons differ, {horizons[0]} to {horizons[-1]} steps: EL and SR are not like for like"
        )
    platforms = [sorted({str(row["platform"]) for row in rows}) for rows in (ours, theirs)]
    if platforms[0] != platforms[1] or len(platforms[0]) > 1:
        notes.append(f"platforms: A {', '.join(platforms[0])}; B {', '.join(platforms[1])}")
    censored = [sum(row["outcome"] == "completed" for row in rows) for rows in (ours, theirs)]
    if any(censored):
        notes.append(
            f"EL is cut off at the horizon in {censored[0]} of {len(ours)} trials of A and {censored[1]} of "
            f"{len(theirs)} of B: how much longer they would have lasted is not known"
        )
    if min(len(ours), len(theirs)) == 1:
        notes.append("a single trial gives no interval")
    return tuple(notes)
