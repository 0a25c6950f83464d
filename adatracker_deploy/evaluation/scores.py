"""Scores of the grid: AR, EL and SR by cell and overall, and differences between policies.

Overall values are means of the cells' means. Their intervals take the cells as the independent values
(clusters): episodes of one body are alike, so a thousand of them say little about the next body. A difference
is paired, episode by episode of equal seeds, then treated in the same way.
"""

from __future__ import annotations

import dataclasses
import itertools
import statistics
from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from adatracker_deploy.evaluation.eyes import Sights
from adatracker_deploy.evaluation.grid import CELLS, Cell
from adatracker_deploy.scoring.stats.intervals import Estimate, mean_estimate, share_estimate

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from adatracker_deploy.evaluation.play import Episode, Played

METRICS: dict[str, Callable[[Played], float]] = {
    "ar": lambda played: played.ar,
    "el": lambda played: float(played.el),
    "sr": lambda played: float(played.success),
}


@dataclass(frozen=True, slots=True)
class Metrics:
    """The paper's three numbers."""

    ar: Estimate
    """Accumulated reward."""
    el: Estimate
    """Episode length, steps."""
    sr: Estimate
    """Share of episodes that reached the horizon."""


@dataclass(frozen=True, slots=True)
class CellScore:
    """One policy in one cell."""

    cell: Cell
    episodes: Mapping[int, Played]
    """By seed; at least one."""

    def values(self, metric: str) -> list[float]:
        """Return a metric of every episode."""
        return [METRICS[metric](played) for played in self.episodes.values()]

    @property
    def metrics(self) -> Metrics:
        """Over its episodes."""
        hits = sum(played.success for played in self.episodes.values())
        return Metrics(
            mean_estimate(self.values("ar")),
            mean_estimate(self.values("el")),
            share_estimate(hits, len(self.episodes)),
        )


@dataclass(frozen=True, slots=True)
class PolicyScore:
    """One policy over the grid."""

    name: str
    cells: tuple[CellScore, ...]
    """Those of which at least one episode was played, in the order of `CELLS`."""

    @classmethod
    def of(cls, name: str, episodes: Sequence[tuple[Episode, Played]]) -> Self:
        """Sort a policy's episodes into cells."""
        by_cell: dict[Cell, dict[int, Played]] = defaultdict(dict)
        for episode, played in episodes:
            spec = episode.spec
            by_cell[Cell(spec.embodiment.height_m, spec.target_speed_m_s)][spec.seed] = played
        return cls(name, tuple(CellScore(cell, by_cell[cell]) for cell in CELLS if cell in by_cell))

    @property
    def metrics(self) -> Metrics:
        """Over the grid; SR's interval is Wilson's over all episodes, because a share has no spread at 1."""
        episodes = [played for score in self.cells for played in score.episodes.values()]
        pooled = share_estimate(sum(played.success for played in episodes), len(episodes))
        share = statistics.fmean(self.cell_means("sr"))
        return Metrics(
            mean_estimate(self.cell_means("ar")),
            mean_estimate(self.cell_means("el")),
            Estimate(share, pooled.low, pooled.high),
        )

    @property
    def floored_ar(self) -> float:
        """AR with the published simulator's floor (`Played.floored_ar`), the mean of the cells' means."""
        return statistics.fmean(
            statistics.fmean(played.floored_ar for played in score.episodes.values()) for score in self.cells
        )

    @property
    def sights(self) -> Sights | None:
        """The eyes' scores, the mean of all episodes; None where the masks were the truth's."""
        seen = [each.sights for cell in self.cells for each in cell.episodes.values() if each.sights]
        if not seen:
            return None
        return Sights(
            *(statistics.fmean(values) for values in zip(*map(dataclasses.astuple, seen), strict=True))
        )

    def cell_means(self, metric: str) -> list[float]:
        """Return each cell's mean of a metric."""
        return [statistics.fmean(score.values(metric)) for score in self.cells]


@dataclass(frozen=True, slots=True)
class Difference:
    """The amount by which one policy exceeds another on the same episodes."""

    policy: str
    baseline: str
    episodes: int
    """That both have played."""
    metrics: Metrics


def difference(policy: PolicyScore, baseline: PolicyScore) -> Difference | None:
    """Return `policy` less `baseline`, or None where they share no episode."""
    others = {score.cell: score.episodes for score in baseline.cells}
    pairs = [
        [(played, others[score.cell][seed]) for seed, played in score.episodes.items() if seed in met]
        for score in policy.cells
        if (met := others.get(score.cell, {}))
    ]
    pairs = [cell for cell in pairs if cell]
    if not pairs:
        return None
    ar, el, sr = (
        mean_estimate(
            [statistics.fmean(value(ours) - value(theirs) for ours, theirs in cell) for cell in pairs]
        )
        for value in METRICS.values()
    )
    return Difference(policy.name, baseline.name, sum(map(len, pairs)), Metrics(ar, el, sr))


def differences(scores: Sequence[PolicyScore]) -> list[Difference]:
    """Return the difference of every pair, the earlier less the later."""
    found = (difference(ours, theirs) for ours, theirs in itertools.combinations(scores, 2))
    return [each for each in found if each is not None]
