"""The ROS 2 robot's platform class: its adapter, and its simulator for rehearsals."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_ros2.adapter.adapter import Ros2Adapter
from adatracker_ros2.sim.settings import SitlSettings

if TYPE_CHECKING:
    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.platform import Body, Sitl


class Ros2Platform(Ros2Adapter):
    """The platform of ``--platform ros2``, real or simulated."""

    SitlSettings = SitlSettings

    @classmethod
    def body(cls, profile: Profile) -> Body:
        """Return the dynamics of a base on wheels."""
        from adatracker_ros2.sim.dynamics import Ros2Body

        return Ros2Body(profile.sitl)

    @classmethod
    def sitl(cls, profile: Profile) -> Sitl:
        """Return a simulated robot with its camera, in its own process; needs the sitl extra."""
        from adatracker_ros2.sim.sitl import Ros2Sitl

        return Ros2Sitl(profile)
