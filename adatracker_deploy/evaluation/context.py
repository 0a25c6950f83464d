"""Probes what the latent context z encodes of a body, and how fast: pure functions of recorded contexts.

z is taken less its mean over all bodies wherever directions are compared: a constant would look settled.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.learning.change import Change
from adatracker_deploy.learning.embodiment import Embodiment

Array = NDArray[np.float64]

TRUTHS: dict[str, Callable[[Embodiment], float]] = {
    "height_m": lambda body: body.height_m,
    "log forward_m_s": lambda body: math.log(body.forward_m_s),
    "log yaw_rate_rad_s": lambda body: math.log(body.yaw_rate_rad_s),
    "lag_s": lambda body: body.lag_s,
    "delay_s": lambda body: body.delay_s,
    "pitch_deg": lambda body: body.pitch_deg,
    "fov_deg": lambda body: body.fov_deg,
}
"""The quantities regressed on z; limits by their logarithm, because they scale what an action does."""

FIRST_TICK = 20
"""z is judged from this tick on: by then a history of 16 pairs is full."""
EVERY_TICKS = 10
"""Nearer ones are much the same."""
RIDGE = 1.0
"""On standardised contexts; small against hundreds of ticks."""
SETTLED = 0.95
"""Share of the final cosine at which a context counts as settled."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """One body's contexts over an episode."""

    embodiment: Embodiment
    """At its start."""
    contexts: NDArray[np.float32]
    """(T, Z), one a tick."""
    change: Change | None = None
    """Of the body, amid the episode."""

    def body_at(self, tick: int) -> Embodiment:
        """Return what the body is at a tick."""
        if self.change is None or tick < self.change.at_step:
            return self.embodiment
        return self.change.of(self.embodiment)

    @property
    def mean(self) -> Array:
        """z of this body: the mean from `FIRST_TICK` on, or over all of a shorter episode, (Z,)."""
        ticks = self.contexts if len(self.contexts) <= FIRST_TICK else self.contexts[FIRST_TICK:]
        mean: Array = ticks.mean(axis=0, dtype=np.float64)
        return mean


def plane(points: Array) -> tuple[Array, Array]:
    """Return points (N, Z) in the plane of their largest spread, (N, 2), and each axis' share of variance.

    Raises:
        ValueError: fewer than two points or dimensions.
    """
    if min(points.shape) < 2:
        raise ValueError(f"{points.shape} points span no plane")
    _, spread, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    variance = spread**2
    shares: Array = variance[:2] / max(variance.sum(), 1e-12)
    return (points - points.mean(axis=0)) @ axes[:2].T, shares


def explained(bodies: Sequence[Recorded]) -> dict[str, float | None]:
    """Return R^2 of a ridge regression from one tick's z to each of `TRUTHS`, on bodies it has not seen.

    Every other body is for fitting. R^2 is 1 for a perfect answer and 0 for always the fitted mean; it may be
    negative. None where all bodies are alike.

    Raises:
        ValueError: fewer than four bodies.
    """
    if len(bodies) < 4:
        raise ValueError("held-out R^2 needs four bodies at least")
    (fit, fit_on), (held, held_on) = _ticks(bodies[::2]), _ticks(bodies[1::2])
    middle, scale = fit.mean(axis=0), np.maximum(fit.std(axis=0), 1e-6)
    fit, held = (fit - middle) / scale, (held - middle) / scale
    inverse = np.linalg.solve(fit.T @ fit + RIDGE * np.eye(fit.shape[1]), fit.T)
    scores: dict[str, float | None] = {}
    for name, truth in TRUTHS.items():
        known, wanted = (np.array([truth(body) for body in of_ticks]) for of_ticks in (fit_on, held_on))
        guess = known.mean() + held @ (inverse @ (known - known.mean()))
        spread = float(((wanted - wanted.mean()) ** 2).sum())
        scores[name] = 1.0 - float(((wanted - guess) ** 2).sum()) / spread if spread > 1e-12 else None
    return scores


def settling(bodies: Sequence[Recorded]) -> Array:
    """Return, a tick, the mean cosine between z and the mean z of the same body, shape (longest T,)."""
    centre = np.mean([body.mean for body in bodies], axis=0)
    longest = max(len(body.contexts) for body in bodies)
    cosines = np.full((len(bodies), longest), np.nan)
    for row, body in zip(cosines, bodies, strict=True):
        moved, mean = body.contexts - centre, body.mean - centre
        lengths = np.linalg.norm(moved, axis=1) * np.linalg.norm(mean)
        row[: len(moved)] = moved @ mean / np.maximum(lengths, 1e-12)
    curve: Array = np.nanmean(cosines, axis=0)
    return curve


def settled_tick(cosines: Array) -> int | None:
    """Return the first tick at which the cosine is `SETTLED` of its mean over the second half, if any."""
    reached = float(cosines[len(cosines) // 2 :].mean())
    if reached <= 0:
        return None
    return int(np.argmax(cosines >= SETTLED * reached))


def _ticks(bodies: Sequence[Recorded]) -> tuple[Array, list[Embodiment]]:
    """Return single ticks of z, (N, Z), and the body at each."""
    chosen = [
        range(min(FIRST_TICK, len(body.contexts) - 1), len(body.contexts), EVERY_TICKS) for body in bodies
    ]
    contexts = [body.contexts[list(ticks)] for body, ticks in zip(bodies, chosen, strict=True)]
    on = [body.body_at(tick) for body, ticks in zip(bodies, chosen, strict=True) for tick in ticks]
    return np.concatenate(contexts).astype(np.float64), on
