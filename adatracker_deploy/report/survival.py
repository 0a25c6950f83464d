"""How many trials are still following after so many steps."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence


class Life(NamedTuple):
    """One trial's length."""

    steps: int
    failed: bool
    """It ended there; otherwise it reached its horizon, and how long it would have gone on is not known."""


def survival_curve(lives: Sequence[Life]) -> list[tuple[int, float]]:
    """Return the product-limit estimate as (steps, share still following from there on), from (0, 1).

    At each length with d failures among the n trials that were followed until then, the share is multiplied
    by 1 - d / n. Trials that reached their horizon count in n up to it. Source: E. L. Kaplan and P. Meier,
    "Nonparametric estimation from incomplete observations", 1958.
    """
    share = 1.0
    curve = [(0, share)]
    for steps in sorted({life.steps for life in lives if life.failed}):
        failures = sum(life.failed and life.steps == steps for life in lives)
        share *= 1 - failures / sum(life.steps >= steps for life in lives)
        curve.append((steps, share))
    return curve
