"""A body that changes amid an episode: a payload, a weak battery, wet ground."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Self

from adatracker_deploy.config.schema import Range

if TYPE_CHECKING:
    import numpy as np

    from adatracker_deploy.learning.embodiment import Embodiment

_WHEN = (0.3, 0.7)
"""Earliest and latest share of an episode."""
_FORWARD, _YAW = (0.8, 1.0), (0.6, 1.0)
"""A body that loses more of its forward speed could not keep up with the conditions' targets, to which its
limit is 1.3."""
_MORE_LAG_S = (0.0, 0.4)

Gain = Annotated[float, Range(0.05, 1)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """From `at_step` on, an action of 1 brings less speed, and brings it later."""

    at_step: Annotated[int, Range(1, 100_000)]
    forward: Gain = 1.0
    """Share that is left of the speeds forward and backward."""
    yaw: Gain = 1.0
    """Share that is left of the yaw rate."""
    more_lag_s: Annotated[float, Range(0, 1)] = 0.0
    """Added to the lag; not imposed on a drone, which has its own dynamics."""

    @classmethod
    def drawn(cls, rng: np.random.Generator, steps: int) -> Self:
        """Return a change amid an episode of `steps` steps."""
        low, high = (round(share * steps) for share in _WHEN)
        return cls(
            at_step=max(1, int(rng.integers(low, high + 1))),
            forward=float(rng.uniform(*_FORWARD)),
            yaw=float(rng.uniform(*_YAW)),
            more_lag_s=float(rng.uniform(*_MORE_LAG_S)),
        )

    def of(self, body: Embodiment) -> Embodiment:
        """Return what a body is after the change."""
        return replace(
            body,
            forward_m_s=body.forward_m_s * self.forward,
            backward_m_s=body.backward_m_s * self.forward,
            yaw_rate_rad_s=body.yaw_rate_rad_s * self.yaw,
            lag_s=body.lag_s if body.kind == "drone" else min(body.lag_s + self.more_lag_s, 2.0),
        )
