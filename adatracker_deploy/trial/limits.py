"""The limits that a trial was run with, by its log."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.config.schema import parse
from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from adatracker_deploy.trial.reader import Trial


def limits_of(trial: Trial) -> Limits:
    """Return the limits that a trial was run with.

    Raises:
        UsageError: its log lacks them, or they are invalid.
    """
    profile = trial.config.get("profile")
    limits = profile.get("limits") if isinstance(profile, dict) else None
    if limits is None:
        raise UsageError(f"{trial.path}: lacks the robot's limits, by which actions become commands")
    return parse(Limits, limits, where=f"{trial.path}: limits")
