"""What is it worth to know the body, and the target's motion? The expert told the truth, and told otherwise.

python benchmarks/body.py [--condition wide ...] [--target] [--episodes 4] [--seed 77] [--workers 2]

The expert sees where everybody is, so nothing but its idea of the body is wrong: the most that a context
could bring to a policy which knows all else. It is told, in turn, the truth; the truth but for one thing,
which is that of the middle of the condition's ranges; and such a body altogether, which also knows of no
change. Differences are paired by episode; cells are the independent values.

With --target it is told the true body and, while the mask shows the target, where that is; but it learns how
the target moves only late: as an average of its velocity over so long.
"""

from __future__ import annotations

import argparse
import cmath
import math
from collections import deque
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from statistics import fmean

from adatracker_deploy.core.messages import Twist
from adatracker_deploy.evaluation.grid import CELLS, Grid
from adatracker_deploy.evaluation.play import Episode
from adatracker_deploy.learning.conditions import YAW_RATE_RAD_S, Condition, condition_named
from adatracker_deploy.learning.embodiment import Embodiment
from adatracker_deploy.learning.episode_spec import RATE_HZ
from adatracker_deploy.learning.expert import Expert, ExpertGains
from adatracker_deploy.learning.tracking import ACTION, Tracking
from adatracker_deploy.policy.base import to_twist
from adatracker_deploy.scoring.stats.intervals import mean_estimate

THINGS: dict[str, tuple[str, ...]] = {
    "nothing": (),
    "delay": ("delay_s",),
    "lag": ("lag_s",),
    "limits": ("forward_m_s", "backward_m_s", "yaw_rate_rad_s"),
    "all": ("delay_s", "lag_s", "forward_m_s", "backward_m_s", "yaw_rate_rad_s"),
}
"""What it is told wrongly."""


class Mistaken(Expert):
    """Takes the body for another; what it is not mistaken about, it knows through every change."""

    def __init__(self, tracking: Tracking, wrong: dict[str, float]) -> None:
        super().__init__(tracking)
        self._wrong = wrong
        self._delayed = deque([Twist()] * round(RATE_HZ * replace(tracking.spec.embodiment, **wrong).delay_s))

    @property
    def _limits(self) -> Embodiment:
        return replace(self._tracking.embodiment, **self._wrong)


BELIEVING = ExpertGains(settling_s=0.2, lead=0.15, believes=True)
LATE_S = {"at once": 0.0, "over 0.2 s": 0.2, "over 0.4 s": 0.4, "over 0.8 s": 0.8}
"""How late it learns how the target moves: time constants of an average."""


class Late(Expert):
    """Knows no more than the masks show, and the target's velocity by an exponential average."""

    def __init__(self, tracking: Tracking, time_constant_s: float) -> None:
        super().__init__(tracking, BELIEVING)
        self._newest = 1.0 - math.exp(-1.0 / (RATE_HZ * time_constant_s)) if time_constant_s else 1.0
        self._velocity = 0j

    def _watch(self) -> None:
        super()._watch()
        now = cmath.rect(self._speed, self._heading)
        self._velocity += self._newest * (now - self._velocity)
        self._speed, self._heading = cmath.polar(self._velocity)
        if self._newest < 1.0:
            self._turning = 0.0  # an average knows of none


def middle(condition: Condition, target_speed_m_s: float) -> dict[str, float]:
    """Return the body of the middle of a condition's ranges; scales by their geometric mean."""
    forward_m_s = max(1.0, 1.3 * target_speed_m_s) * math.sqrt(math.prod(condition.forward_scale))
    return {
        "delay_s": fmean(condition.delay_steps) / RATE_HZ,
        "lag_s": fmean(condition.lag_s),
        "forward_m_s": forward_m_s,
        "backward_m_s": forward_m_s * fmean(condition.backward_share),
        "yaw_rate_rad_s": YAW_RATE_RAD_S * math.sqrt(math.prod(condition.yaw_rate_scale)),
    }


def accumulated(job: tuple[Episode, dict[str, float] | float]) -> float:
    """Return an episode's reward under an expert that is so mistaken of the body, or so late."""
    episode, wrong = job
    tracking = Tracking(episode.spec, episode.spec.task_settings(episode.steps))
    mask = tracking.begin().mask
    expert = Mistaken(tracking, wrong) if isinstance(wrong, dict) else Late(tracking, wrong)
    rewards = []
    while True:
        command = to_twist(expert.act(mask), ACTION, tracking.limits)
        tick = tracking.follow(command)
        expert.executed(command)
        rewards.append(tick.reward)
        mask = tick.observation.mask
        if tick.end:
            return math.fsum(rewards)


def asked_of(name: str, plan: list[Episode], *, target: bool) -> dict[str, list[dict[str, float] | float]]:
    """Return what is told wrongly in each episode, by its name; the first is the truth."""
    if target:
        return {late: [time_s] * len(plan) for late, time_s in LATE_S.items()}
    bodies = [middle(condition_named(name), episode.spec.target_speed_m_s) for episode in plan]
    return {
        thing: [{field: body[field] for field in fields} for body in bodies]
        for thing, fields in THINGS.items()
    }


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--condition", nargs="+", default=["field", "wide"])
    parser.add_argument("--target", action="store_true", help="what the target's motion is worth")
    parser.add_argument("--episodes", type=int, default=4, help="a cell")
    parser.add_argument("--seed", type=int, default=77)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    kind = "target's motion known" if asked.target else "told wrongly"
    print(f"| condition | {kind} | AR | less the truth's |\n|---|---|---|---|")
    with ProcessPoolExecutor(asked.workers, get_context("spawn")) as pool:
        for name in asked.condition:
            plan = Grid(policies=("pid",), condition=name, episodes=asked.episodes, seed=asked.seed).plan()
            truth: list[float] = []
            for thing, wrong in asked_of(name, plan, target=asked.target).items():
                scores = list(pool.map(accumulated, zip(plan, wrong, strict=True), chunksize=2))
                interval = ""
                if truth:
                    gaps = [score - best for score, best in zip(scores, truth, strict=True)]
                    less = mean_estimate([fmean(gaps[index :: len(CELLS)]) for index in range(len(CELLS))])
                    interval = f"{less.value:.0f} [{less.low:.0f}, {less.high:.0f}]"
                truth = truth or scores
                print(f"| `{name}` | {thing} | {fmean(scores):.0f} | {interval} |", flush=True)


if __name__ == "__main__":
    main()
