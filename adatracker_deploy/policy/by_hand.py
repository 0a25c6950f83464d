"""The policy of a trial that is driven by hand alone: it asks for nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.core.messages import Action
from adatracker_deploy.policy.base import PolicyInfo

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Observation

BY_HAND_NAME = "teleop"
RATE_HZ = 20.0


class ByHand:
    """Stands in for a policy, and is named in the log as one: tables put a person beside the policies."""

    info = PolicyInfo(name=BY_HAND_NAME, rate_hz=RATE_HZ, action=())

    def reset(self, seed: int = 0) -> None:
        """Do nothing: there is nothing to forget."""

    def act(self, observation: Observation) -> Action:  # noqa: ARG002 -- the operator looks, not this
        """Return an action without a number."""
        return Action(np.empty(0, np.float32))
