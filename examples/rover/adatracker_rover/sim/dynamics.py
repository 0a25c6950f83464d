"""The rover's dynamics: a differential drive with wheels that are not quite equal. Pure."""

from __future__ import annotations

import dataclasses
import math
import random

from adatracker_deploy import Pose, Twist
from adatracker_deploy.sim import KinematicBody

from adatracker_rover.sim.settings import SitlSettings


class RoverBody(KinematicBody):
    """Adds to the toolkit's drive what this robot is known for; deterministic by seed."""

    settings: SitlSettings

    def reset(self, pose: Pose, seed: int) -> None:
        """Stand still at `pose`; the seed decides to which side it veers, and how much."""
        super().reset(pose, seed)
        most_rad_m = math.radians(self.settings.veer_deg_m)
        self._veer_rad_m = random.Random(seed).uniform(-most_rad_m, most_rad_m)

    def step(self, command: Twist, dt_s: float) -> None:
        """Advance by `dt_s` seconds."""
        yaw_rate = command.yaw_rate + self._veer_rad_m * self.velocity.vx
        super().step(dataclasses.replace(command, yaw_rate=yaw_rate), dt_s)
