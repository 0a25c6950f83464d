"""The simulated world that rehearsal and learning share: scenes, people, ray-cast camera, bodies, episodes.

`caster` is the only module that imports MuJoCo, when the first world is built; `stage` puts a scene before it
and `camera` renders that. `world` puts it all together, `bodies` is what moves in it, `task` is the paper's
episode with its rules, and `episode` runs a policy through one in lock-step, without a wire.
"""

from adatracker_deploy.sim.scenes import describe_scenes, scene_names
from adatracker_deploy.sim.world import World, check_scene

__all__ = ["World", "check_scene", "describe_scenes", "scene_names"]
