"""Ticks settle just behind the observations, and the rate is kept meanwhile."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.messages import Frame, Observation, Seen
from adatracker_deploy.runtime.phase import MOST, WAIT, earlier_s

PERIOD_S = 0.1
NOTHING = np.zeros((1, 1), np.uint8)


def seen(ready_s, spacing_s):
    return Seen(
        Frame(np.zeros((1, 1, 3), np.uint8), 0, 0),
        Observation(NOTHING, None, 0.0, 0, 0),
        ready_ns=None if ready_s is None else round(ready_s * 1e9),
        spacing_ns=None if spacing_s is None else round(spacing_s * 1e9),
    )


def ticks(camera_hz, first_s, jitter_s=0.0, count=400, seed=0):
    """Times of slots, and how long each one's observation had waited; below 0 was waited for."""
    rng = np.random.default_rng(seed)
    ready = np.arange(1, 6000) / camera_hz + rng.uniform(0, jitter_s, 5999)
    at, waited, times = 1.0 + first_s, [], []
    for _ in range(count):
        place = int(np.searchsorted(ready, at, side="right")) - 1
        if at - ready[place] > 0.5 / camera_hz:
            place += ready[place + 1] - at < WAIT * PERIOD_S
        times.append(at)
        waited.append(at - ready[place])
        at += PERIOD_S - earlier_s(seen(ready[place], 1 / camera_hz), round(at * 1e9), PERIOD_S)
    return np.array(times), np.array(waited)


@pytest.mark.parametrize("camera_hz", [10.0, 20.0, 30.0, 60.0])
@pytest.mark.parametrize("first_s", [0.0, 0.013, 0.031, 0.049])
def test_ticks_settle_behind_the_observations(camera_hz, first_s):
    times, waited = ticks(camera_hz, first_s)
    assert np.abs(waited[-100:]).max() < 1e-3
    assert np.diff(times[-100:]) == pytest.approx(PERIOD_S, rel=1e-3)


@pytest.mark.parametrize("camera_hz", [19.8, 20.2])
def test_they_keep_up_with_a_camera_whose_rate_is_a_little_off(camera_hz):
    _, waited = ticks(camera_hz, 0.02)
    assert waited[-100:].max() < 0.012


@pytest.mark.parametrize("jitter_s", [0.006, 0.020, 0.028, 0.032])
def test_a_perception_whose_time_varies_never_makes_them_act_on_the_observation_before(jitter_s):
    _, waited = ticks(20.0, 0.02, jitter_s)
    assert abs(np.median(waited[-200:])) < 0.005
    assert waited[-200:].max() < jitter_s


@given(st.floats(3.0, 120.0), st.floats(0.0, 0.1), st.floats(0.0, 0.05), st.integers(0, 9))
def test_whatever_comes_the_rate_is_kept_within_two_per_cent(camera_hz, first_s, jitter_s, seed):
    times, _ = ticks(camera_hz, first_s, jitter_s, 60, seed)
    gaps = np.diff(times) / PERIOD_S
    assert gaps.min() >= 1 - MOST - 1e-9
    assert gaps.max() <= 1 + MOST + 1e-9


@pytest.mark.parametrize(("ready_s", "spacing_s"), [(None, None), (0.5, None), (None, 0.5)])
def test_what_is_not_known_moves_nothing(ready_s, spacing_s):
    assert earlier_s(seen(ready_s, spacing_s), 10**9, PERIOD_S) == 0.0


@given(st.integers(0, 10**12), st.integers(-(10**12), 10**12), st.integers(-(10**12), 10**12))
def test_any_times_give_a_bounded_correction(tick_ns, ready_ns, spacing_ns):
    moved_s = earlier_s(seen(ready_ns / 1e9, spacing_ns / 1e9), tick_ns, PERIOD_S)
    assert math.isfinite(moved_s)
    assert abs(moved_s) <= MOST * PERIOD_S
