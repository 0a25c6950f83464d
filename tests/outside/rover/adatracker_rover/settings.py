"""The profile's two sections: how the rover is reached, and what the simulated one is like."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from adatracker_deploy.config.schema import Range
from adatracker_deploy.sim.bodies import DriveSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class Connection:
    """The rover's address, and when not to trust it; times are the machine's seconds at any clock speed."""

    host: str
    port: Annotated[int, Range(1, 65535)] = 5005
    min_battery: Annotated[float, Range(0, 1)] = 0.2
    """Charge needed to engage."""
    report_timeout_s: Annotated[float, Range(0.05, 2)] = 0.3
    """Without a report for so long, stop driving: what cannot be seen is not steered."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SitlSettings(DriveSettings):
    """The simulated rover; the policy never sees any of it."""

    veer_deg_m: Annotated[float, Range(0, 20)] = 2.0
    """No two wheels are equal: it turns by up to so much for every metre, as the seed will have it."""
    command_timeout_s: Annotated[float, Range(0, 10)] = 0.5
    """The rover's own; 0 switches it off, to see the preflight refuse."""
    battery: Annotated[float, Range(0, 1)] = 0.9
    """State of charge."""
