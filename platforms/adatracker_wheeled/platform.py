"""The wheeled base's platform class: its adapter, and its simulator for rehearsals."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_wheeled.adapter.adapter import WheeledAdapter
from adatracker_wheeled.sim.settings import SitlSettings

if TYPE_CHECKING:
    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.platform import Body, Sitl


class WheeledPlatform(WheeledAdapter):
    """The platform of ``--platform wheeled``, real or simulated."""

    SitlSettings = SitlSettings

    @classmethod
    def body(cls, profile: Profile) -> Body:
        """Return the base's dynamics."""
        from adatracker_wheeled.sim.dynamics import WheeledBody

        return WheeledBody(profile.sitl, profile.connection.roles)

    @classmethod
    def sitl(cls, profile: Profile) -> Sitl:
        """Return a simulated base behind a socketcand, in its own process; needs the sitl extra."""
        from adatracker_wheeled.sim.sitl import WheeledSitl

        return WheeledSitl(profile)
