"""Recipes: the distribution of a data set's episodes, as a YAML file."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

import numpy as np

from adatracker_deploy.config.schema import Range, parse
from adatracker_deploy.config.yaml_text import read_yaml
from adatracker_deploy.core.camera import is_unreal
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.change import Change
from adatracker_deploy.learning.embodiment import DRONE_DELAY_S, DRONE_LAG_S, BodyKind, Embodiment
from adatracker_deploy.learning.episode_spec import RATE_HZ, EpisodeSpec
from adatracker_deploy.learning.expert import DEFAULT_GAINS, ExpertGains
from adatracker_deploy.learning.view import pitch_in_view_deg
from adatracker_deploy.sim.noise import NoiseLevel
from adatracker_deploy.sim.path import PathName
from adatracker_deploy.sim.scenes import scene_names
from adatracker_deploy.sim.worlds import check_scene

Number = Annotated[float, Range(-1e3, 1e3)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Between:
    """A number drawn evenly from an interval."""

    low: Number
    high: Number

    def __post_init__(self) -> None:
        if self.low > self.high:
            raise UsageError(f"low {self.low:g} is above high {self.high:g}")

    @property
    def ends(self) -> tuple[float, float]:
        """Return the least and the largest."""
        return self.low, self.high

    def draw(self, rng: np.random.Generator) -> float:
        """Return one of them."""
        return float(rng.uniform(self.low, self.high))


@dataclass(frozen=True, slots=True, kw_only=True)
class OneOf:
    """One of a few numbers, each as likely."""

    one_of: tuple[Number, ...]

    def __post_init__(self) -> None:
        if not self.one_of:
            raise UsageError("one_of is empty")

    @property
    def ends(self) -> tuple[float, float]:
        """Return the least and the largest."""
        return min(self.one_of), max(self.one_of)

    def draw(self, rng: np.random.Generator) -> float:
        """Return one of them."""
        return self.one_of[int(rng.integers(len(self.one_of)))]


Spread = Between | OneOf
_AS_DRAWN = ("height_m", "pitch_deg", "fov_deg", "aspect", "forward_m_s", "lag_s")
"""Keys that are a body's own; no more may be drawn than a body can have."""
_BODY = get_type_hints(Embodiment, include_extras=True)
Weights = dict[str, Annotated[float, Range(0, 1e6)]]
"""The weight of each named choice, relative to the others."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe:
    """The distribution of one data set; every draw depends only on the episode's seed."""

    name: str
    description: str
    steps: Annotated[int, Range(1, 1_000_000_000)]
    """Number of steps to collect unless the command says otherwise."""
    episode_steps: Annotated[int, Range(2, 100_000)] = 500
    scenes: Weights
    kinds: Weights
    height_m: Spread
    pitch_deg: Spread
    """Moved as little as is needed to have the target in view at the start."""
    fov_deg: Spread
    aspect: Spread = OneOf(one_of=(1.0,))
    """Height of a picture as a share of its width: 0.75 is that of most cameras."""
    forward_m_s: Spread
    """The body's limit."""
    backward_share: Spread
    """The backward limit, as a share of the forward limit."""
    target_share: Spread
    """The target's speed, as a share of the limit forward."""
    yaw_rate_deg_s: Spread
    lag_s: Spread
    delay_steps: Spread
    """Delay in steps of 0.1 s, rounded to whole steps."""
    change: Annotated[float, Range(0, 1)] = 0.0
    """Share of the episodes amid which the body changes (`change.Change`)."""
    paths: Weights
    obstacles: Annotated[float, Range(0, 1)]
    """Share of the episodes with obstacles in the arena."""
    others: Spread
    """Other people."""
    crossing: Spread
    """Largest number of them that cross the line of sight."""
    noise: Weights
    perturbed: Annotated[float, Range(0.01, 1)] = 1.0
    """Share of the time in which the expert is perturbed; below 1 in bouts, and between them it recovers."""

    expert: ExpertGains = DEFAULT_GAINS
    """How hard the expert steers, both as it is perturbed and as it labels."""

    def draw(self, seed: int) -> EpisodeSpec:
        """Return the episode that this seed stands for."""
        rng = np.random.default_rng([seed, 0x4EC1])
        kind = _weighted(rng, self.kinds)
        height_m, fov_deg = self.height_m.draw(rng), self.fov_deg.draw(rng)
        aspect = self.aspect.draw(np.random.default_rng([seed, 0xA59EC7]))
        pitch_deg = pitch_in_view_deg(self.pitch_deg.draw(rng), height_m, fov_deg, aspect)
        forward_m_s = self.forward_m_s.draw(rng)
        others = round(self.others.draw(rng))
        embodiment = Embodiment(
            kind=kind,
            height_m=height_m,
            pitch_deg=pitch_deg,
            fov_deg=fov_deg,
            aspect=aspect,
            forward_m_s=forward_m_s,
            backward_m_s=forward_m_s * self.backward_share.draw(rng),
            yaw_rate_rad_s=math.radians(self.yaw_rate_deg_s.draw(rng)),
            lag_s=self.lag_s.draw(rng),
            delay_s=round(self.delay_steps.draw(rng)) / RATE_HZ,
        )
        if kind == "drone":
            embodiment = replace(embodiment, lag_s=DRONE_LAG_S, delay_s=DRONE_DELAY_S)
        spec = EpisodeSpec(
            seed=seed,
            embodiment=embodiment,
            scene=_weighted(rng, self.scenes),
            target_speed_m_s=forward_m_s * self.target_share.draw(rng),
            path=_weighted(rng, self.paths),
            obstacles=bool(rng.random() < self.obstacles),
            others=others,
            crossing=min(others, round(self.crossing.draw(rng))),
            noise=_weighted(rng, self.noise),
        )
        if rng.random() >= self.change:
            return spec
        return replace(spec, change=Change.drawn(rng, self.episode_steps))


@dataclass(frozen=True, slots=True)
class Mixture:
    """Recipes of which each episode is drawn from one, each as likely; by the first's rules."""

    name: str
    recipes: tuple[Recipe, ...]

    @property
    def episode_steps(self) -> int:
        """Return the episodes' length."""
        return self.recipes[0].episode_steps

    @property
    def expert(self) -> ExpertGains:
        """Return the expert's gains."""
        return self.recipes[0].expert

    def draw(self, seed: int) -> EpisodeSpec:
        """Return the episode that this seed stands for."""
        index = int(np.random.default_rng([seed, 0x313]).integers(len(self.recipes)))
        return self.recipes[index].draw(seed)


def recipe_names() -> list[str]:
    """Return the names of the shipped recipes, sorted."""
    folder = files("adatracker_deploy.learning") / "recipes"
    return sorted(
        entry.name.removesuffix(".yaml") for entry in folder.iterdir() if entry.name.endswith(".yaml")
    )


def load_recipe(name_or_path: str) -> Recipe:
    """Read a shipped recipe by name, or any by path (with a slash or a .yaml ending).

    Raises:
        UsageError: no such recipe, not YAML, or a wrong key, type or range.
    """
    if _is_path(name_or_path):
        path = Path(name_or_path)
    elif name_or_path in recipe_names():
        path = Path(str(files("adatracker_deploy.learning") / "recipes" / f"{name_or_path}.yaml"))
    else:
        names = ", ".join(recipe_names())
        raise UsageError(f"unknown recipe {name_or_path!r}: known are {names}; or give a path to a YAML file")
    return parse_recipe(read_yaml(path), where=str(path), name=path.stem)


def _is_path(name_or_path: str) -> bool:
    return "/" in name_or_path or name_or_path.endswith(".yaml")


def load_mixture(names: str) -> Recipe | Mixture:
    """Read a recipe as `load_recipe`, or several shipped ones, whose names are joined by ``+``.

    Raises:
        UsageError: as `load_recipe`; or their episodes' lengths or their experts differ.
    """
    if "+" not in names or _is_path(names):
        return load_recipe(names)
    recipes = tuple(load_recipe(name) for name in names.split("+"))
    if len({(each.episode_steps, each.expert) for each in recipes}) > 1:
        raise UsageError(f"recipe {names!r}: the lengths of their episodes or their experts differ")
    return Mixture(names, recipes)


def parse_recipe(value: Any, *, where: str, name: str) -> Recipe:
    """Check a recipe as YAML gives it; its name is its file's.

    Raises:
        UsageError: a wrong key, type or range, or choices that nothing can be drawn from.
    """
    if isinstance(value, dict) and "name" not in value:
        value = {"name": name, **value}
    recipe = parse(Recipe, value, where=where)
    for key, known in (
        ("scenes", scene_names()),
        ("kinds", get_args(BodyKind)),
        ("paths", get_args(PathName)),
        ("noise", get_args(NoiseLevel)),
    ):
        weights: Weights = getattr(recipe, key)
        for choice in weights:
            if key == "scenes" and is_unreal(choice):
                check_scene(choice)
            elif choice not in known:
                raise UsageError(f"{where}: {key}: unknown choice {choice!r}; known are {', '.join(known)}")
        if not any(weights.values()):
            raise UsageError(f"{where}: {key}: needs at least one choice with a weight above 0")
    for key in _AS_DRAWN:
        bounds = next(each for each in _BODY[key].__metadata__ if isinstance(each, Range))
        for number in getattr(recipe, key).ends:
            if not bounds.low <= number <= bounds.high:
                raise UsageError(
                    f"{where}: {key}: {number:g} is out of range [{bounds.low:g}, {bounds.high:g}]"
                )
    return recipe


def _weighted(rng: np.random.Generator, weights: dict[Any, float]) -> Any:
    names = list(weights)
    share = np.array([weights[name] for name in names])
    return names[int(rng.choice(len(names), p=share / share.sum()))]
