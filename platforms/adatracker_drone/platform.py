"""The drone's platform class: its adapter, and its simulator for rehearsals."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_drone.adapter.adapter import DroneAdapter
from adatracker_drone.sim.settings import SitlSettings

if TYPE_CHECKING:
    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.platform import Body, Sitl


class DronePlatform(DroneAdapter):
    """The platform of ``--platform drone``, real or simulated."""

    SitlSettings = SitlSettings

    @classmethod
    def body(cls, profile: Profile) -> Body:
        """Return the quadrotor's dynamics; needs the sitl extra."""
        from adatracker_drone.sim.dynamics import DroneBody

        return DroneBody(profile.sitl)

    @classmethod
    def sitl(cls, profile: Profile) -> Sitl:
        """Return a simulated PX4 vehicle in a process of its own; needs the sitl extra."""
        from adatracker_drone.sim.sitl import DroneSitl

        return DroneSitl(profile)
