"""The address of the rover: the profile's ``connection:`` section."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from adatracker_deploy import Range


@dataclass(frozen=True, slots=True, kw_only=True)
class Connection:
    """The rover's address, and when not to trust it; times are the machine's seconds at any clock speed."""

    host: str
    port: Annotated[int, Range(1, 65535)] = 5005
    min_battery: Annotated[float, Range(0, 1)] = 0.2
    """Charge needed to engage."""
    report_timeout_s: Annotated[float, Range(0.05, 2)] = 0.3
    """Without a report for so long, stop driving: what cannot be seen is not steered."""
