"""Runs a policy at its own rate on observations of any rate, as the loop does, without the loop.

Pure but for the policy's state; time is that of the observations.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.policy.base import STALE_OBSERVATION_S

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Action, Observation
    from adatracker_deploy.policy.base import Policy


class RateAdapter:
    """Ticks at the policy's rate from the first observation on; each tick uses the newest one, unless too
    old."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self._period_ns = 1e9 / policy.info.rate_hz
        self._began_ns = 0
        self._tick = 0
        self._last: Observation | None = None
        self._action: Action | None = None

    def act(self, observation: Observation) -> Action | None:
        """Run the ticks up to this observation's time; return the last one's action.

        None means no action: the observation was too old.
        """
        if self._last is None:
            self._began_ns, self._last = observation.t_ns, observation
        while (tick_ns := self._began_ns + round(self._tick * self._period_ns)) <= observation.t_ns:
            newest = observation if tick_ns == observation.t_ns else self._last
            stale = tick_ns - newest.t_ns > STALE_OBSERVATION_S * 1e9
            self._action = None if stale else self._policy.act(newest)
            self._tick += 1
        self._last = observation
        return self._action
