"""The expert: follows by ground truth; an upper bound for everything that imitates it.

It knows the body's limits, lag and delay and the target's position and velocity. It predicts the moment when
its action takes effect, and steers so that soon after the body will be at 2.5 m and bearing zero from the
target's position then: proportional control with feed-forward of the target's motion. It plans no path around
obstacles: at 2.5 m behind somebody who walks around them it is led past; an obstacle that it touches turns it
aside.

A policy that imitates it sees less: nothing of a target that has left its view, is hidden or is missing in
the mask. So an expert may be made to know only what the masks show (`ExpertGains.believes`).

Gains were chosen on tuning seeds (see `seeds`). On others of those, one episode for each of the paper's 16
bodies, AR/EL/SR were 498/500/1.00 in `clean`, 489/500/1.00 in `field` and 449/500/1.00 in `hard`.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.config.schema import Range
from adatracker_deploy.core.geometry import wrap_angle
from adatracker_deploy.core.messages import ClassMask, MaskClass, Twist
from adatracker_deploy.core.task import DESIRED_DISTANCE_M
from adatracker_deploy.learning.embodiment import Embodiment
from adatracker_deploy.learning.episode_spec import RATE_HZ
from adatracker_deploy.learning.tracking import Tracking
from adatracker_deploy.sim.bodies import lag_share

_DT_S = 1.0 / RATE_HZ

COAST_S = 1.0
SEARCH_S = 2.0
"""Of 1 to 2.5 s each, these had the highest AR in `hard`, and no SR was higher (64 tuning episodes)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpertGains:
    """The gains of the expert's controller.

    `lead` feeds the body's own velocity back, negative, ``lead * (1 / share - 1)`` times, with the share of a
    difference in speed that the body closes in a step: 3.2 times by default where the lag is 0.5 s. Above 1,
    a clone that takes a body without lag for one with it alternates at every step (`recipes/offline.yaml`).
    """

    settling_s: Annotated[float, Range(_DT_S, 5)] = _DT_S
    """It means to be right again so many seconds after its action works, and `lags` times the body's lag."""
    lags: Annotated[float, Range(0, 5)] = 0.5
    lead: Annotated[float, Range(0, 1)] = 0.7
    """Share of the body's lag that is made up for by commanding more than is wanted."""
    curve: Annotated[float, Range(0, 1)] = 0.8
    """Share of the target's turning that is taken to go on."""
    believes: bool = False
    """It knows where the target is only while the mask shows it. After that it believes the target to walk on
    for `COAST_S` and then to stand; from `SEARCH_S` on it turns round, to the side on which it last saw the
    target: a clone knows that, but hardly on which side of straight ahead the belief is.

    On 64 tuning episodes of `hard` (settling 0.2 s, lead 0.15): 359/494/0.94; without this 424/500/1.00.
    """


DEFAULT_GAINS = ExpertGains()


@dataclass(frozen=True, slots=True)
class _State:
    """The body's position and velocity."""

    x: float
    y: float
    yaw: float
    forward: float
    turn: float


class Expert:
    """The expert in one episode; it must be given every executed action, its own or not."""

    def __init__(self, tracking: Tracking, gains: ExpertGains = DEFAULT_GAINS) -> None:
        self._tracking = tracking
        self._gains = gains
        body = tracking.spec.embodiment
        self._delayed: deque[Twist] = deque([Twist()] * round(body.delay_s / _DT_S))
        self._target = self._seen = tracking.task.world.target_xy
        self._speed = self._heading = self._turning = 0.0
        self._gap_s = 0.0
        self._side = 1.0

    @property
    def _limits(self) -> Embodiment:
        return self._tracking.embodiment

    @property
    def _share(self) -> float:
        """Share of a difference in speed that the body closes in a step."""
        return lag_share(self._limits.lag_s, _DT_S)

    def act(self, mask: ClassMask) -> NDArray[np.float32]:
        """Return the action for now, shape (2,) in [-1, 1]; call once a step, before the step is made.

        Args:
            mask: what is seen now, (H, W); of no account unless it `believes`.
        """
        if self._gains.believes and not np.any(mask == MaskClass.TARGET):
            self._believe()
        else:
            self._watch()
        state = self._when_it_works()
        ahead_s = self._gains.settling_s + self._gains.lags * self._limits.lag_s
        aim_x, aim_y = self._target_in(_DT_S * len(self._delayed) + ahead_s)
        away_x, away_y = aim_x - state.x, aim_y - state.y
        bearing = wrap_angle(math.atan2(away_y, away_x) - state.yaw)
        # The bearing will be that of the place the body gets to, not of where it is.
        forward = (math.hypot(away_x, away_y) - DESIRED_DISTANCE_M) / ahead_s * max(0.0, math.cos(bearing))
        if self._gap_s > SEARCH_S:
            return np.array([0.0, self._side], np.float32)
        turn = bearing / ahead_s
        return self._normalised(self._led(forward, state.forward), self._led(turn, state.turn))

    def executed(self, command: Twist) -> None:
        """Learn what was really commanded, so that what is still under way is known."""
        self._delayed.append(command)
        self._delayed.popleft()

    def _watch(self) -> None:
        x, y = self._tracking.task.world.target_xy
        vx, vy = (x - self._seen[0]) / _DT_S, (y - self._seen[1]) / _DT_S
        walks = math.hypot(vx, vy) > 0.05
        heading = math.atan2(vy, vx) if walks else self._heading
        went_on = self._speed > 0.05 and walks and not self._gap_s
        self._turning = wrap_angle(heading - self._heading) / _DT_S if went_on else 0.0
        self._target, self._speed, self._heading = (x, y), math.hypot(vx, vy), heading
        self._seen, self._gap_s = (x, y), 0.0
        pose = self._tracking.task.body.pose
        self._side = math.copysign(1.0, wrap_angle(math.atan2(y - pose.y, x - pose.x) - pose.yaw))

    def _believe(self) -> None:
        self._seen = self._tracking.task.world.target_xy  # the next sight's velocity is measured from here
        self._gap_s += _DT_S
        self._turning *= self._gains.curve
        self._heading = wrap_angle(self._heading + self._turning * _DT_S)
        if self._gap_s > COAST_S:
            self._speed = self._turning = 0.0
        self._target = self._target_in(_DT_S)

    def _target_in(self, seconds: float) -> tuple[float, float]:
        """Return where the target will be, along an arc."""
        along = self._heading + self._gains.curve * self._turning * seconds / 2
        reach = self._speed * seconds
        return self._target[0] + reach * math.cos(along), self._target[1] + reach * math.sin(along)

    def _when_it_works(self) -> _State:
        """Return the body's state when this step's action begins to work, by what is still under way."""
        body = self._tracking.task.body
        pose, velocity = body.pose, body.velocity
        state = _State(pose.x, pose.y, pose.yaw, velocity.vx, velocity.yaw_rate)
        for command in self._delayed:
            state = self._after(state, command)
        return state

    def _after(self, state: _State, command: Twist) -> _State:
        forward = state.forward + self._share * (command.vx - state.forward)
        turn = state.turn + self._share * (command.yaw_rate - state.turn)
        along = state.yaw + turn * _DT_S / 2
        return _State(
            state.x + forward * _DT_S * math.cos(along),
            state.y + forward * _DT_S * math.sin(along),
            state.yaw + turn * _DT_S,
            forward,
            turn,
        )

    def _led(self, wanted: float, now: float) -> float:
        """Return the command that brings a lagging velocity to `wanted` sooner."""
        return wanted + self._gains.lead * (1.0 / self._share - 1.0) * (wanted - now)

    def _normalised(self, forward: float, turn: float) -> NDArray[np.float32]:
        body = self._limits
        action = np.array([forward / body.forward_m_s, turn / body.yaw_rate_rad_s], np.float32)
        return action.clip(-1.0, 1.0)
