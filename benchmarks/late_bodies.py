"""What do policies score with bodies that obey later than most?

python benchmarks/late_bodies.py [--policy NAME ...] [--episodes 4] [--seed 0] [--workers 2]

The grid of `evaluate` in `field`, with the same delay and lag for every body; all else of an episode stays.
`expert` is the expert that knows everything, `believing` the one that knows no more than the masks show.
"""

from __future__ import annotations

import argparse
import math
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from statistics import fmean

from adatracker_deploy.evaluation.grid import Grid
from adatracker_deploy.evaluation.play import Episode, Played, play_all
from adatracker_deploy.learning.data.rollout import Rollout
from adatracker_deploy.learning.expert import ExpertGains

LATE = ((0.0, 0.0), (0.6, 0.0), (0.0, 1.0), (0.6, 1.0))
"""Delay and lag, s."""
EXPERTS = {"expert": ExpertGains(), "believing": ExpertGains(believes=True)}


def later(episode: Episode, delay_s: float, lag_s: float) -> Episode:
    """Return the same episode with a body of this delay and lag."""
    body = replace(episode.spec.embodiment, delay_s=delay_s, lag_s=lag_s)
    return replace(episode, spec=replace(episode.spec, embodiment=body))


def driven_by_expert(episode: Episode) -> Played:
    """Play an episode with the expert that its policy names."""
    rollout = Rollout(episode.spec, episode.steps, EXPERTS[episode.policy])
    while not rollout.ended:
        rollout.step(rollout.expert)
    _, steps = rollout.record()
    return Played(math.fsum(steps.rewards.tolist()), len(steps), success=not steps.done[-1])


def played(jobs: list[Episode], workers: int) -> list[Played]:
    """Play them, in any order."""
    if jobs[0].policy not in EXPERTS:
        return [score for _, score in play_all(jobs, workers)]
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        return list(pool.map(driven_by_expert, jobs))


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--policy", nargs="+", default=["adatracker", "pid"])
    parser.add_argument("--episodes", type=int, default=4, help="a cell")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    print("| policy | delay, s | lag, s | AR/EL/SR |\n|---|---|---|---|")
    for policy in asked.policy:
        known = "pid" if policy in EXPERTS else policy
        grid = Grid(policies=(known,), condition="field", episodes=asked.episodes, seed=asked.seed)
        plan = [replace(episode, policy=policy) for episode in grid.plan()]
        for delay_s, lag_s in LATE:
            jobs = [later(episode, delay_s, lag_s) for episode in plan]
            scores = played(jobs, asked.workers)
            ar, el, sr = (fmean(getattr(score, name) for score in scores) for name in ("ar", "el", "success"))
            print(f"| {policy} | {delay_s} | {lag_s} | {ar:.0f}/{el:.0f}/{sr:.2f} |", flush=True)


if __name__ == "__main__":
    main()
