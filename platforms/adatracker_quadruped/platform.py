"""The quadruped's platform class: its adapter, and its simulator for rehearsals."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_quadruped.adapter.adapter import QuadrupedAdapter
from adatracker_quadruped.sim.settings import SitlSettings

if TYPE_CHECKING:
    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.platform import Body, Sitl


class QuadrupedPlatform(QuadrupedAdapter):
    """The platform of ``--platform quadruped``, real or simulated."""

    SitlSettings = SitlSettings

    @classmethod
    def body(cls, profile: Profile) -> Body:
        """Return the walking dynamics."""
        from adatracker_quadruped.sim.dynamics import QuadrupedBody

        return QuadrupedBody(profile.sitl)

    @classmethod
    def sitl(cls, profile: Profile) -> Sitl:
        """Return a simulated robot with its camera, in its own process; needs the sitl extra."""
        from adatracker_quadruped.sim.sitl import QuadrupedSitl

        return QuadrupedSitl(profile)
