"""The simulated world that rehearsal and learning share: scenes, people, ray-cast camera, bodies, episodes.

`stage` is the only module that imports MuJoCo, when the first world is built, and `camera` renders what it
holds; the others are pure. `world` puts them together, `bodies` is what moves in it, `task` is the paper's
episode with its rules, and `episode` runs a policy through one in lock-step, without a wire.
"""

from adatracker_deploy.world.scenes import describe_scenes, scene_names
from adatracker_deploy.world.world import World, check_scene

__all__ = ["World", "check_scene", "describe_scenes", "scene_names"]
