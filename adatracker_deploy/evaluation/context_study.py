"""Context study of a policy: many bodies, a few episodes each, and the results."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.evaluation.context import Recorded, explained, settled_tick, settling
from adatracker_deploy.evaluation.play import Episode, Played
from adatracker_deploy.learning.data.recipe import load_recipe
from adatracker_deploy.learning.seeds import FIRST_EVALUATION
from adatracker_deploy.scoring.stats.intervals import Estimate, mean_estimate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from adatracker_deploy.evaluation.context import Array

    Play = Callable[[Sequence[Episode]], Iterable[tuple[int, Played]]]
    """As `play_all` with its workers given."""

RECIPE = "deploy"
"""The bodies are this recipe's, unless another's are asked for: heights, limits, lags and delays without the
grid's gaps."""
_SEEDS_FROM = FIRST_EVALUATION + 1_000_000_000
"""Far from the grid's."""


@dataclass(frozen=True, slots=True)
class Swap:
    """The cost, in AR, of giving a policy another z than its encoder's, on the same episodes."""

    own: Estimate
    """AR with the encoder's z, a tick."""
    frozen: Estimate
    """Change of AR when z is this body's mean from the start."""
    swapped: Estimate
    """Change of AR when z is another body's mean."""


@dataclass(frozen=True, slots=True)
class ContextStudy:
    """The study's findings about one policy."""

    bodies: tuple[Recorded, ...]
    r2: dict[str, float | None]
    """See `explained`."""
    cosines: Array
    """See `settling`."""
    settled_tick: int | None
    swap: Swap | None

    def record(self) -> dict[str, Any]:
        """Return it as plain values."""
        swap = None if self.swap is None else dataclasses.asdict(self.swap)
        return {
            "bodies": len(self.bodies),
            "r2": self.r2,
            "settled_tick": self.settled_tick,
            "cosines": [round(float(cosine), 4) for cosine in self.cosines],
            "swap": swap,
        }


def study_context(
    policy: str,
    play: Play,
    *,
    bodies: int,
    recipe: str = RECIPE,
    seed: int = 0,
    steps: int = 500,
    swap: bool = False,
) -> ContextStudy:
    """Play one episode by each of many bodies and look at z.

    Args:
        policy: as `load_policy` takes it.
        play: plays episodes.
        bodies: how many, at least 8.
        recipe: that they are drawn from, its name or path.
        seed: of the bodies and episodes, all of them kept for evaluation.
        steps: the horizon.
        swap: play each episode twice more, with this body's mean z throughout and with another body's.

    Raises:
        UsageError: too few bodies, no such recipe, a policy without context, or a horizon too short to see z
            settle.
    """
    if bodies < 8:
        raise UsageError(f"{bodies} bodies are too few to study the context: take at least 8")
    drawn_from = load_recipe(recipe)
    first = _SEEDS_FROM + seed * 1_000_000
    episodes = [
        Episode(policy=policy, spec=drawn_from.draw(first + number), steps=steps, with_contexts=True)
        for number in range(bodies)
    ]
    own = _played(play, episodes)
    recorded = tuple(
        Recorded(episode.spec.embodiment, played.contexts, episode.spec.change)
        for episode, played in zip(episodes, own, strict=True)
        if played.contexts is not None
    )
    cosines = settling(recorded)
    return ContextStudy(
        recorded,
        explained(recorded),
        cosines,
        settled_tick(cosines),
        _swap(play, episodes, own, recorded) if swap else None,
    )


def _swap(play: Play, episodes: Sequence[Episode], own: Sequence[Played], bodies: Sequence[Recorded]) -> Swap:
    """Play again with z imposed; the other body is the next one: they are in random order."""
    means = np.array([body.mean for body in bodies], np.float32)
    imposed = [
        [
            dataclasses.replace(episode, with_contexts=False, imposed=z)
            for episode, z in zip(episodes, given, strict=True)
        ]
        for given in (means, np.roll(means, 1, axis=0))
    ]
    again = _played(play, [*imposed[0], *imposed[1]])
    frozen, swapped = again[: len(episodes)], again[len(episodes) :]
    return Swap(
        mean_estimate([played.ar for played in own]),
        mean_estimate([now.ar - before.ar for now, before in zip(frozen, own, strict=True)]),
        mean_estimate([now.ar - before.ar for now, before in zip(swapped, own, strict=True)]),
    )


def _played(play: Play, episodes: Sequence[Episode]) -> list[Played]:
    """Return what came of each, in the order of `episodes`."""
    results = dict(play(episodes))
    return [results[index] for index in range(len(episodes))]
