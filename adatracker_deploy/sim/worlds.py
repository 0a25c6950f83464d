"""Opens a world by its scene's name: one that is built here, or one of Unreal's engine."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.config.effects import NONE, Effects
from adatracker_deploy.core.camera import is_unreal
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.sim import world
from adatracker_deploy.sim.unreal.address import parse_address

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from adatracker_deploy.sim.backend import WorldBackend
    from adatracker_deploy.sim.path import PathName


def check_scene(name: str) -> None:
    """Check a scene's name before anything moves; no server is asked yet.

    Raises:
        UsageError: no scene has this name, or what simulates it is not installed, or its settings are wrong.
    """
    if not is_unreal(name):
        world.check_scene(name)
        return
    from adatracker_deploy.sim.unreal.settings import read_settings

    read_settings(parse_address(name).settings)


def check_pictures(scene: str) -> None:
    """Check that what draws pictures of a scene for real eyes is installed; an engine draws its own.

    Raises:
        UsageError: it is not.
    """
    if not is_unreal(scene):
        from adatracker_deploy.sim.render.renderer import check_renderer

        check_renderer()


def open_world(
    scene: str,
    *,
    seed: int,
    target_speed_m_s: float = 1.0,
    path: PathName = "s_path",
    obstacles: bool = True,
    others: int = 0,
    crossing: int = 0,
    cast: Sequence[Path] = (),
    effects: Effects = NONE,
    lock_step: bool = True,
) -> WorldBackend:
    """Return the world of one episode, not stepped yet.

    Args:
        scene: one of `scene_names`, or ``unrealcv/HOST:PORT/LEVEL``.
        seed: seeds what is random; the engine's people walk as they like.
        target_speed_m_s: how fast everybody walks.
        path: the target's.
        obstacles: whether the arena has obstacles; a level of the engine has what it has.
        others: how many other people walk about.
        crossing: how many of them cross the robot's line of sight; the engine's people do not.
        cast: glTF files of who plays whom; not in the engine.
        effects: fog, and whether people sit down; not in the engine.
        lock_step: an engine stands still between the world's steps; a world built here always does.

    Raises:
        UsageError: no such scene or path, or what simulates it is missing.
        PlatformError: the engine fails.
    """
    if not is_unreal(scene):
        return world.World(
            scene,
            seed=seed,
            target_speed_m_s=target_speed_m_s,
            path=path,
            obstacles=obstacles,
            others=others,
            crossing=crossing,
            cast=cast,
            effects=effects,
        )
    if crossing:
        raise UsageError("people who cross the line of sight on purpose: Unreal's levels have none")
    if effects.fog_m or effects.sit:
        raise UsageError("fog, and people who sit down: Unreal's levels have their own weather and people")
    from adatracker_deploy.sim.unreal.engine import engine_at
    from adatracker_deploy.sim.unreal.world import UnrealWorld

    return UnrealWorld(
        engine_at(parse_address(scene)),
        seed=seed,
        target_speed_m_s=target_speed_m_s,
        path=path,
        others=others,
        lock_step=lock_step,
    )
