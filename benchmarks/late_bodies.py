"""What do policies score with bodies that obey later than most?

python benchmarks/late_bodies.py [--policy NAME ...] [--episodes 4] [--seed 0] [--workers 2]

The grid of `evaluate` in `field`, with the same delay and lag for every body; all else of an episode stays.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from statistics import fmean

from adatracker_deploy.evaluation.grid import Grid
from adatracker_deploy.evaluation.play import Episode, play_all

LATE = ((0.0, 0.0), (0.6, 0.0), (0.0, 1.0), (0.6, 1.0))
"""Delay and lag, s."""


def later(episode: Episode, delay_s: float, lag_s: float) -> Episode:
    """Return the same episode with a body of this delay and lag."""
    body = replace(episode.spec.embodiment, delay_s=delay_s, lag_s=lag_s)
    return replace(episode, spec=replace(episode.spec, embodiment=body))


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
        plan = Grid(policies=(policy,), condition="field", episodes=asked.episodes, seed=asked.seed).plan()
        for delay_s, lag_s in LATE:
            jobs = [later(episode, delay_s, lag_s) for episode in plan]
            played = [score for _, score in play_all(jobs, asked.workers)]
            ar, el, sr = (fmean(getattr(score, name) for score in played) for name in ("ar", "el", "success"))
            print(f"| {policy} | {delay_s} | {lag_s} | {ar:.0f}/{el:.0f}/{sr:.2f} |", flush=True)


if __name__ == "__main__":
    main()
