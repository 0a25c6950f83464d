"""The world is faithful: a policy trained elsewhere by others scores in it what they measured."""

from __future__ import annotations

import statistics
from pathlib import Path

import pytest

from benchmarks.fidelity import PUBLISHED_AR, published_policy, reference_episode
from tests.tiers import EXHAUSTIVE

CHECKPOINT = Path(__file__).parents[2].parent / "shared" / "data" / "offline_evt_public.pth"
EPISODES = 3
"""Episodes differ by 13 in AR: their mean by 8, a quarter of what is allowed."""
TOLERANCE = 0.08

pytestmark = pytest.mark.skipif(
    not CHECKPOINT.is_file(),
    reason="the published Offline-EVT checkpoint has no licence, so it is not shipped",
)


@pytest.fixture(scope="module")
def policy():
    return published_policy(CHECKPOINT)


@EXHAUSTIVE
@pytest.mark.parametrize(("target_speed_m_s", "ar"), PUBLISHED_AR.items())
def test_the_published_policy_scores_what_its_paper_says(policy, target_speed_m_s, ar):
    episodes = [reference_episode(policy, target_speed_m_s, seed) for seed in range(EPISODES)]
    assert all(episode.success for episode in episodes)
    assert statistics.fmean(episode.ar for episode in episodes) == pytest.approx(ar, rel=TOLERANCE)
