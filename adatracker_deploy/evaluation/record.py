"""The grid's scores as plain values: the JSON of `evaluate`. Keys are a contract: none is ever renamed."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from adatracker_deploy.evaluation.grid import CELLS, Cell
from adatracker_deploy.evaluation.published import PUBLISHED, Published
from adatracker_deploy.evaluation.scores import METRICS, CellScore, Difference, Metrics, PolicyScore
from adatracker_deploy.scoring.stats.intervals import mean_std

if TYPE_CHECKING:
    from collections.abc import Sequence

    from adatracker_deploy.evaluation.grid import Grid

Record = dict[str, Any]


def grid_record(
    grid: Grid, scores: Sequence[PolicyScore], differences: Sequence[Difference], seconds: float
) -> Record:
    """Return everything about a run of the grid; infinite bounds are None.

    Args:
        grid: what was asked for.
        scores: of the policies that have played.
        differences: between them.
        seconds: that it took.
    """
    played = sum(len(cell.episodes) for score in scores for cell in score.cells)
    record: Record = {
        "condition": grid.condition,
        "scene": grid.scene,
        "episodes": grid.episodes,
        "seed": grid.seed,
        "steps": grid.steps,
        "segmenter": grid.segmenter,
        "aspect": grid.shown_aspect,
        "played": played,
        "complete": played == grid.episodes * len(CELLS) * len(grid.policies),
        "seconds": round(seconds, 1),
        "policies": {score.name: _policy(score) for score in scores},
        "differences": [_difference(each) for each in differences],
    }
    if grid.is_the_papers:
        record["published"] = {row.name: _published(row) for row in PUBLISHED}
    return record


def _policy(score: PolicyScore) -> Record:
    return {
        "mean": _values(score.metrics),
        "interval": _intervals(score.metrics),
        "std": {metric: mean_std(score.cell_means(metric))[1] for metric in METRICS},
        "floored_ar": score.floored_ar,
        "cells": [_cell(cell) for cell in score.cells],
        "sight": dataclasses.asdict(score.sights) if score.sights else None,
    }


def _cell(score: CellScore) -> Record:
    return {
        **_where(score.cell),
        **_values(score.metrics),
        "interval": _intervals(score.metrics),
        "episodes": [
            {
                "seed": seed,
                "ar": played.ar,
                "floored_ar": played.floored_ar,
                "el": played.el,
                "success": played.success,
            }
            for seed, played in sorted(score.episodes.items())
        ],
    }


def _difference(each: Difference) -> Record:
    return {
        "policy": each.policy,
        "baseline": each.baseline,
        "episodes": each.episodes,
        "mean": _values(each.metrics),
        "interval": _intervals(each.metrics),
    }


def _published(row: Published) -> Record:
    return {
        "mean": dict(zip(METRICS, row.mean, strict=True)),
        "cells": [
            {**_where(cell), **dict(zip(METRICS, triple, strict=True))} for cell, triple in row.cells.items()
        ],
    }


def _where(cell: Cell) -> Record:
    return {"height_m": cell.height_m, "target_speed_m_s": cell.target_speed_m_s}


def _values(metrics: Metrics) -> dict[str, float]:
    return {metric: getattr(metrics, metric).value for metric in METRICS}


def _intervals(metrics: Metrics) -> dict[str, list[float | None]]:
    return {metric: getattr(metrics, metric).bounds for metric in METRICS}
