"""The properties of the simulated rover: the profile's ``sitl:`` section."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from adatracker_deploy import Range
from adatracker_deploy.sim import DriveSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class SitlSettings(DriveSettings):
    """The simulated rover; the policy never sees any of it."""

    veer_deg_m: Annotated[float, Range(0, 20)] = 2.0
    """No two wheels are equal: it turns by up to so much for every metre, as the seed will have it."""
    command_timeout_s: Annotated[float, Range(0, 10)] = 0.5
    """The rover's own; 0 switches it off, to see the preflight refuse."""
    battery: Annotated[float, Range(0, 1)] = 0.9
    """State of charge."""
