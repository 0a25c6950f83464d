"""Ablation study: variants with a few training seeds each, compared by their seeds' scores.

The paper compares single runs. Here training seeds are the independent values: an arm's mean and its interval
are over its seeds (each the mean over the grid), and the difference to the whole method is Welch's, so that
what another seed would change is in the interval. Three seeds make wide intervals; that is what three tell.
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rich.table import Table
from rich.text import Text

from adatracker_deploy.evaluation.rows import interval_text, signed_text
from adatracker_deploy.evaluation.scores import METRICS
from adatracker_deploy.scoring.stats.intervals import Estimate, mean_difference, mean_estimate

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from adatracker_deploy.evaluation.scores import PolicyScore

_DIGITS = {"ar": 0, "el": 0, "sr": 2}


@dataclass(frozen=True, slots=True)
class ArmScore:
    """One arm under one condition."""

    name: str
    seeds: tuple[Mapping[str, float], ...]
    """AR, EL and SR of each training seed, over the grid, and AR with the published simulator's floor."""

    @classmethod
    def of(cls, name: str, scores: Sequence[PolicyScore]) -> ArmScore:
        """Take the scores of an arm's seeds."""
        return cls(
            name,
            tuple(
                {metric: statistics.fmean(score.cell_means(metric)) for metric in METRICS}
                | {"floored_ar": score.floored_ar}
                for score in scores
            ),
        )

    def values(self, metric: str) -> list[float]:
        """Return a metric of every seed."""
        return [seed[metric] for seed in self.seeds]

    def mean(self, metric: str) -> Estimate:
        """Return a metric's mean over the seeds."""
        return mean_estimate(self.values(metric))

    def less(self, other: ArmScore, metric: str) -> Estimate:
        """Return by how much a metric exceeds another arm's."""
        return mean_difference(self.values(metric), other.values(metric))


def ablation_table(condition: str, arms: Sequence[ArmScore]) -> Table:
    """Draw the arms, each less the first; bold where zero is excluded."""
    whole = arms[0]
    count = len(whole.seeds)
    title = (
        f"{condition}: means over {count} training seed{'s' if count > 1 else ''}, 95 % intervals over them"
    )
    table = Table(title=title, title_justify="left", title_style="italic", box=None, padding=(0, 2, 0, 0))
    less_whole = (f"AR less {whole.name}", f"SR less {whole.name}")
    for column in ("arm", "AR/EL/SR", "AR of each seed", "AR, floor -1", *less_whole):
        table.add_column(column, justify="left" if column == "arm" else "right")
    for arm in arms:
        means = "/".join(f"{arm.mean(metric).value:z.{_DIGITS[metric]}f}" for metric in METRICS)
        less = (
            [Text("")] * 2
            if arm is whole
            else [signed_text(arm.less(whole, m), _DIGITS[m]) for m in ("ar", "sr")]
        )
        seeds = " ".join(f"{ar:z.0f}" for ar in arm.values("ar"))
        table.add_row(arm.name, means, seeds, f"{arm.mean('floored_ar').value:z.0f}", *less)
    return table


def ablation_latex(condition: str, arms: Sequence[ArmScore]) -> str:
    """Return the paper's ablation table: a row an arm, AR/EL/SR."""
    rows = [
        f"    {arm.name} & {arm.mean('ar').value:z.0f}/{arm.mean('el').value:.0f}/{arm.mean('sr').value:.2f} "
        + ("& \\\\" if arm is arms[0] else f"& {_latex_interval(arm.less(arms[0], 'ar'))} \\\\")
        for arm in arms
    ]
    head = [f"% {condition}, {len(arms[0].seeds)} training seeds", "\\begin{tabular}{lcc}", "    \\toprule"]
    titles = [f"    & AR/EL/SR & AR less {arms[0].name} [95\\,\\%] \\\\", "    \\midrule"]
    return "\n".join([*head, *titles, *rows, "    \\bottomrule", "\\end{tabular}", ""])


def ablation_record(arms: Sequence[ArmScore]) -> dict[str, Any]:
    """Return the arms as plain values, infinite bounds as None."""
    return {
        arm.name: {
            "seeds": [dict(seed) for seed in arm.seeds],
            "mean": {metric: arm.mean(metric).value for metric in METRICS},
            "interval": {metric: arm.mean(metric).bounds for metric in METRICS},
            **(
                {}
                if arm is arms[0]
                else {
                    "less": {m: [arm.less(arms[0], m).value, *arm.less(arms[0], m).bounds] for m in METRICS}
                }
            ),
        }
        for arm in arms
    }


def _latex_interval(estimate: Estimate) -> str:
    return f"{estimate.value:+z.0f} {interval_text(estimate, 0)}".rstrip()
