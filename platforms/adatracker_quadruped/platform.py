"""The quadruped: its adapter, and the simulator that stands in its place in rehearsals."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_quadruped.adapter.adapter import QuadrupedAdapter
from adatracker_quadruped.sim.settings import SitlSettings

if TYPE_CHECKING:
    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.platform import Body, Sitl


class QuadrupedPlatform(QuadrupedAdapter):
    """What ``--platform quadruped`` drives, and what it rehearses with."""

    SitlSettings = SitlSettings

    @classmethod
    def body(cls, profile: Profile) -> Body:
        """Return the walking dynamics."""
        from adatracker_quadruped.sim.dynamics import QuadrupedBody

        return QuadrupedBody(profile.sitl)

    @classmethod
    def sitl(cls, profile: Profile) -> Sitl:
        """Return a simulated robot, its camera with it, in a process of its own; needs the sitl extra."""
        from adatracker_quadruped.sim.sitl import QuadrupedSitl

        return QuadrupedSitl(profile)
