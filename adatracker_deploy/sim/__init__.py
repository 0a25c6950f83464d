"""The simulator: the world that rehearsal and learning share, and what every robot's simulator is made of.

A robot's package imports the names below. `process` runs a simulator beside the trial, `ground_truth` is what
it writes of itself, `bodies` is what moves. `caster` alone imports MuJoCo, when the first world is built;
`stage` puts a scene before it, `camera` renders that, `world` puts it all together; `task` is the paper's
episode with its rules, and `episode` runs a policy through one in lock-step, without a wire. `backend` says
what a world is to all of these, `worlds` opens one by name, and `unreal` has Unreal's engine simulate it.
"""

from adatracker_deploy.sim.bodies import DriveSettings, KinematicBody
from adatracker_deploy.sim.process import (
    FaultCommands,
    ProcessSitl,
    SimulatorProcess,
    add_arguments,
    announce_ready,
    given_scenario,
    parent_watchdog,
    refuse,
    simulator_clock,
)
from adatracker_deploy.sim.scenes import describe_scenes, scene_names
from adatracker_deploy.sim.world import World
from adatracker_deploy.sim.worlds import check_scene

__all__ = [
    "DriveSettings",
    "FaultCommands",
    "KinematicBody",
    "ProcessSitl",
    "SimulatorProcess",
    "World",
    "add_arguments",
    "announce_ready",
    "check_scene",
    "describe_scenes",
    "given_scenario",
    "parent_watchdog",
    "refuse",
    "scene_names",
    "simulator_clock",
]
