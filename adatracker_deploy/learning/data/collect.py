"""Collects a recipe's data: the perturbed expert in many episodes, shard by shard, on all cores.

A shard depends only on the recipe, the run's seed and its own number. So an interrupted collection can be
resumed, and any number of workers, or a Ray cluster, writes the same files.
"""

from __future__ import annotations

import dataclasses
import json
from typing import TYPE_CHECKING, Any

from adatracker_deploy.core.camera import is_unreal
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.learning.data.perturbation import Perturbation
from adatracker_deploy.learning.data.recipe import Recipe, parse_recipe
from adatracker_deploy.learning.data.rollout import Rollout
from adatracker_deploy.learning.data.shard import (
    SCHEMA,
    SHARD_STEPS,
    Record,
    joined_shard,
    packed_shard,
    read_shard,
    shard_name,
    write_shard,
)
from adatracker_deploy.learning.data.workers import in_processes, on_ray
from adatracker_deploy.learning.seeds import training_seed

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

_ABOUT = "collection.json"


def collect(
    recipe: Recipe,
    out_dir: Path,
    *,
    steps: int | None = None,
    seed: int = 0,
    workers: int = 1,
    ray: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Fill a folder with shards of `SHARD_STEPS` steps; the last one may be smaller.

    Args:
        recipe: what is collected.
        out_dir: made where it is missing; a collection in it that was interrupted is gone on with.
        steps: how many; by default the recipe's.
        seed: of the run.
        workers: processes; 1 stays in this one.
        ray: the address of a Ray cluster that works instead of them, see `on_ray`.
        progress: called after each shard with the steps done and the total.

    Raises:
        UsageError: the folder holds another collection or a damaged shard, cannot be written to, a world or
            body is not installed, or Ray is not or cannot be reached.
    """
    if any(map(is_unreal, recipe.scenes)):  # an engine serves one client
        if ray is not None:
            raise UsageError(f"recipe {recipe.name!r}: levels of an engine are collected here, without --ray")
        workers = 1
    steps = recipe.steps if steps is None else steps
    _claim(out_dir, recipe, seed)
    sizes = [min(SHARD_STEPS, steps - first) for first in range(0, steps, SHARD_STEPS)]
    jobs = [
        (recipe, seed, index, size)
        for index, size in enumerate(sizes)
        if not _is_done(out_dir / shard_name(index), size)
    ]
    done = steps - sum(sizes[index] for _, _, index, _ in jobs)
    if progress is not None:
        progress(done, steps)
    if ray is None:
        collected = in_processes(collect_shard, jobs, workers)
    else:
        collected = on_ray(collect_shard, jobs, ray)
    for index, content in collected:
        write_shard(out_dir / shard_name(index), content)
        done += sizes[index]
        if progress is not None:
            progress(done, steps)


def collect_shard(recipe: Recipe, seed: int, index: int, steps: int) -> tuple[int, bytes]:
    """Collect the `index`-th shard of a run and return its index and its file's content."""
    records: list[Record] = []
    left = steps
    while left:
        episode_seed = training_seed(seed, index, len(records))
        records.append(perturbed_episode(recipe, episode_seed, min(left, recipe.episode_steps)))
        left -= records[-1][0].steps
    return index, packed_shard(joined_shard(f"{recipe.name}, seed {seed}", records))


def perturbed_episode(recipe: Recipe, seed: int, steps: int) -> Record:
    """Return the episode of a seed, driven by the perturbed expert for at most `steps` steps."""
    rollout = Rollout(recipe.draw(seed), steps, recipe.expert)
    perturb = Perturbation.drawn(seed, recipe.perturbed)
    while not rollout.ended:
        rollout.step(perturb(rollout.expert))
    return rollout.record()


def _is_done(path: Path, steps: int) -> bool:
    """Return whether a shard is there; one of another size was the last of a smaller collection."""
    return path.exists() and len(read_shard(path).steps) == steps


def _purpose(about: Any) -> tuple[Any, Any, Recipe] | None:
    """Return schema, seed and recipe of what a folder is for, which may be older than a recipe's key.

    None for what no version has written.
    """
    try:
        recipe = parse_recipe(about["recipe"], where=_ABOUT, name="")
        return about["schema"], about["seed"], recipe
    except (UsageError, KeyError, TypeError):
        return None


def _claim(out_dir: Path, recipe: Recipe, seed: int) -> None:
    """Write down what a folder is for, or see that it is for the same."""
    about = {"schema": SCHEMA, "seed": seed, "recipe": dataclasses.asdict(recipe)}
    path = out_dir / _ABOUT
    try:
        out_dir.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            if any(out_dir.glob("shard-*.npz")):
                raise UsageError(f"{out_dir}: holds shards but no {_ABOUT}; name another folder")
            path.write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
            return
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UsageError(f"{path}: cannot be used: {error}") from error
    if _purpose(found) != (SCHEMA, seed, recipe):
        raise UsageError(
            f"{out_dir}: holds another collection (recipe, seed or schema differ); name another folder"
        )
