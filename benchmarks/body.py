"""What is knowing the body worth? The expert told the truth, and told another body.

python benchmarks/body.py [--condition wide ...] [--episodes 4] [--seed 77] [--workers 2]

The expert sees where everybody is, so nothing but its idea of the body is wrong: the most that a context
could bring to a policy which knows all else. It is told, in turn, the truth; the truth but for one thing,
which is that of the middle of the condition's ranges; and such a body altogether, which also knows of no
change. Differences are paired by episode; cells are the independent values.
"""

from __future__ import annotations

import argparse
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
from adatracker_deploy.learning.expert import Expert
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


def accumulated(job: tuple[Episode, dict[str, float]]) -> float:
    """Return an episode's reward under an expert that is so mistaken."""
    episode, wrong = job
    tracking = Tracking(episode.spec, episode.spec.task_settings(episode.steps))
    mask = tracking.begin().mask
    expert, rewards = Mistaken(tracking, wrong), []
    while True:
        command = to_twist(expert.act(mask), ACTION, tracking.limits)
        tick = tracking.follow(command)
        expert.executed(command)
        rewards.append(tick.reward)
        mask = tick.observation.mask
        if tick.end:
            return math.fsum(rewards)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--condition", nargs="+", default=["field", "wide"])
    parser.add_argument("--episodes", type=int, default=4, help="a cell")
    parser.add_argument("--seed", type=int, default=77)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    print("| condition | told wrongly | AR | less the truth's |\n|---|---|---|---|")
    with ProcessPoolExecutor(asked.workers, get_context("spawn")) as pool:
        for name in asked.condition:
            plan = Grid(policies=("pid",), condition=name, episodes=asked.episodes, seed=asked.seed).plan()
            truth: list[float] = []
            for thing, fields in THINGS.items():
                jobs = []
                for episode in plan:
                    body = middle(condition_named(name), episode.spec.target_speed_m_s)
                    jobs.append((episode, {field: body[field] for field in fields}))
                scores = list(pool.map(accumulated, jobs, chunksize=2))
                truth = truth or scores
                gaps = [score - best for score, best in zip(scores, truth, strict=True)]
                less = mean_estimate([fmean(gaps[index :: len(CELLS)]) for index in range(len(CELLS))])
                interval = f"{less.value:.0f} [{less.low:.0f}, {less.high:.0f}]" if thing != "nothing" else ""
                print(f"| `{name}` | {thing} | {fmean(scores):.0f} | {interval} |", flush=True)


if __name__ == "__main__":
    main()
