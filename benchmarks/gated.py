"""A robot's own body behind the real gate, in the simple room, tick by tick: not in real time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields, replace

from adatracker_deploy.config.limits import Dispensable, Limits
from adatracker_deploy.config.profile import Profile
from adatracker_deploy.core.messages import Box, Observation, PlatformState, Twist
from adatracker_deploy.learning.embodiment import Hovering
from adatracker_deploy.registry import load_platform, load_profile
from adatracker_deploy.runtime.gate import GateState, Setpoint, judge
from adatracker_deploy.sim import World
from adatracker_deploy.sim.bodies import GroundBody

RATE_HZ, SLOTS = 10, 5
RADIUS_M = 0.3
ALTITUDE_M = 1.7
"""Height at which a drone hovers: at that of heads. Rehearsals fly between 1.4 and 2.2 m."""
OFF: tuple[Dispensable, ...] = ("battery", "position_jumped")
"""What the gate of such a run does without, beside what the profile switches off."""


class GatedRobot:
    """A robot with the body, the camera and the limits of its profile; a drone hovers.

    It sees true masks that are `late` ticks of 0.1 s old, as the gate is told.
    """

    def __init__(self, profile: Profile, world: World, seed: int, *, late: int = 0) -> None:
        off = (*OFF, *profile.limits.switched_off)
        self.limits = replace(profile.limits, fence_radius_m=1000.0, altitude_m=None, switched_off=off)
        body = load_platform(profile.platform).body(profile)
        self.body = body if isinstance(body, GroundBody) else Hovering(body, ALTITUDE_M)
        self.body.reset(world.start, seed)
        self._world, self._late = world, late
        self._fov_rad = math.radians(profile.sitl.camera.fov_deg)
        self._state = GateState(armed_ns=0)
        self._seen: list[Observation] = []

    @property
    def now_ns(self) -> int:
        """The time of the newest picture."""
        return (len(self._seen) - 1) * 10**9 // RATE_HZ

    @property
    def boxes(self) -> list[Box | None]:
        """The target's box in every picture, the newest last, as the pictures were taken."""
        return [seen.box for seen in self._seen]

    def look(self) -> Observation:
        """Take a picture, and return the one that is known by now."""
        mask = self._world.render_mask(self.body.camera_pose, self._fov_rad, 48, 64)
        box, seq = Box.of_mask(mask), len(self._seen)
        t_ns = seq * 10**9 // RATE_HZ
        self._seen.append(Observation(mask, box, confidence=1.0 if box else 0.0, t_ns=t_ns, seq=seq))
        return self._seen[max(0, seq - self._late)]

    def drive(self, wanted: Twist, seen: Observation) -> None:
        """Want a velocity for one tick, on the ground of what was seen; everybody walks on."""
        setpoint = Setpoint(
            wanted,
            self.now_ns,
            target_share=seen.box.covered if seen.box else None,
            seen_ns=seen.t_ns,
            others_share=seen.others_share,
        )
        for slot in range(1, 1 + SLOTS):
            at_ns = self.now_ns + slot * 10**9 // RATE_HZ // SLOTS
            told = PlatformState(t_ns=at_ns, engaged=True, pose=self.body.pose, velocity=self.body.velocity)
            self._state, verdict = judge(self.limits, self._state, setpoint, told, at_ns)
            self.body.step(verdict.twist, 1 / RATE_HZ / SLOTS)
            if isinstance(self.body, GroundBody):
                self.body.place(self._world.grounded(self.body.pose, RADIUS_M))
        self._world.step(1 / RATE_HZ, self.body.pose)

    @property
    def collided(self) -> bool:
        """The robot touches an obstacle, a wall or a person."""
        pose = self.body.pose
        return self._world.contact(pose.x, pose.y, pose.z, RADIUS_M) is not None


def limit(text: str) -> tuple[str, float]:
    """Return the name and the number of NAME=NUMBER; ValueError for another text, or another name."""
    name, _, number = text.partition("=")
    if name not in {field.name for field in fields(Limits)}:
        raise ValueError(name)
    return name, float(number)


def limited(platform: str, profile: str = "", limits: Sequence[tuple[str, float]] = ()) -> Profile:
    """Return a robot's profile, by default its usual one, with some limits changed."""
    robot = load_platform(platform)
    loaded = load_profile(profile or robot.default_profile, robot)
    return replace(loaded, limits=replace(loaded.limits, **dict(limits)))
