"""The rover: its adapter, and the simulator that stands in its place in rehearsals."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_rover.adapter.adapter import RoverAdapter
from adatracker_rover.sim.settings import SitlSettings

if TYPE_CHECKING:
    from adatracker_deploy import Body, Profile, Sitl


class RoverPlatform(RoverAdapter):
    """The robot behind ``--platform rover``, with its simulator."""

    SitlSettings = SitlSettings
    profile_dir = Path(__file__).parent / "profiles"

    @classmethod
    def body(cls, profile: Profile) -> Body:
        """Return the rover's dynamics."""
        from adatracker_rover.sim.dynamics import RoverBody

        return RoverBody(profile.sitl)

    @classmethod
    def sitl(cls, profile: Profile) -> Sitl:
        """Return a simulated rover in a process of its own."""
        from adatracker_rover.sim.sitl import RoverSitl

        return RoverSitl(profile)
