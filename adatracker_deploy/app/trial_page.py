"""The operator's page in one trial: what it is told of the run, and what becomes of the operator's clicks."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from adatracker_deploy.core.messages import TargetState
from adatracker_deploy.perception.target.choice import BY_CLICK
from adatracker_deploy.trial.ipc import PageStart

if TYPE_CHECKING:
    from adatracker_deploy.app.trial_plan import TrialPlan
    from adatracker_deploy.config.limits import Limits
    from adatracker_deploy.core.messages import Box, Observation, Pick
    from adatracker_deploy.perception.pipeline import Perception
    from adatracker_deploy.trial.log import TrialLog

CLICK_PATIENCE_S = 120.0
"""Time for the operator to click on somebody (`--target click`) before the trial ends."""


def page_start(plan: TrialPlan, limits: Limits) -> PageStart | None:
    """Return the page as the log's writer is to serve it; None where none was asked for."""
    if plan.page is None:
        return None
    kind = "dry run" if plan.dry_run else "rehearsal" if plan.sitl else "real robot"
    about: dict[str, Any] = {
        "title": f"{plan.platform.name}, {kind}",
        "what": f"{plan.policy.info.name}, {plan.profile.name}",
        "unit": "si",
        "full": {
            "vx": limits.forward_m_s,
            "vy": limits.lateral_m_s,
            "vz": limits.vertical_m_s,
            "yaw_rate": limits.yaw_rate_rad_s,
        },
        "steps": plan.steps,
        "stop": True,
        "by_click": plan.target == BY_CLICK,
    }
    return PageStart(plan.page, about, os.getpid(), unchoosable(plan.segmenter.needs_truth))


def unchoosable(needs_truth: bool) -> str:
    """Return why a segmenter's target cannot be chosen; nothing where it can."""
    return (
        "this segmenter knows the target from the simulation, so nobody can be chosen" if needs_truth else ""
    )


class Clicks:
    """Takes the operator's clicks in one trial, and says in words what became of them.

    Args:
        log: brings the clicks.
    """

    def __init__(self, log: TrialLog) -> None:
        self._log = log
        self._told: int | None = None
        """Number of the last click that was told of."""
        self._awaited = False

    def pass_on(self, perception: Perception) -> None:
        """Hand new clicks to perception, and to nothing else: no click moves a robot."""
        for click in self._log.clicks():
            perception.choose(click)

    def news(self, observation: Observation) -> tuple[str, bool]:
        """Return what the newest observation says of a click, and whether it is a warning; or no words."""
        pick = observation.pick
        if pick is None:
            return "", False
        if pick.click.number != self._told:
            self._told = pick.click.number
            self._awaited = observation.target is TargetState.CHOOSING
            return became(pick), pick.box is None
        if self._awaited and observation.box is not None:
            self._awaited = False
            return f"the new target is in sight, in the box {corners(observation.box)}", False
        return "", False


def became(pick: Pick) -> str:
    """Return in words what became of a click."""
    at = f"click at {pick.click.x:.2f}, {pick.click.y:.2f}"
    if pick.box is None:
        return f"{at}: nobody was found there, so the target is the same as before"
    return f"{at}: the target is the person in the box {corners(pick.box)}"


def corners(box: Box) -> str:
    """Return a box's left, top, right and bottom in words."""
    left, top, right, bottom = box.cx - box.w / 2, box.cy - box.h / 2, box.cx + box.w / 2, box.cy + box.h / 2
    return f"{left:.2f}, {top:.2f}, {right:.2f}, {bottom:.2f}"
