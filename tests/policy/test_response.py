"""The response: how late a body obeys, told from its commands and from where the target then went."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adatracker_deploy.core.geometry import Pose, wrap_angle
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.platform import CameraMount
from adatracker_deploy.policy import response
from adatracker_deploy.policy.past import over_time
from adatracker_deploy.sim.bodies import DriveSettings, KinematicBody

YAW_RAD_S = math.radians(120)
UNSEEN = np.zeros(5, np.float32)


def a_body(delay_s=0.0, lag_s=0.0, yaw_rate_rad_s=YAW_RAD_S):
    settings_of = DriveSettings(
        camera=CameraMount(up_m=1.0),
        forward_m_s=1.0,
        backward_m_s=1.0,
        yaw_rate_rad_s=yaw_rate_rad_s,
        lag_s=lag_s,
        delay_s=delay_s,
    )
    body = KinematicBody(settings_of)
    body.reset(Pose(), 0)
    return body


def sight(bearing):
    """Return how the nominal camera sees a person there; nothing where that is out of the picture."""
    if abs(bearing) > math.radians(42):
        return UNSEEN
    return np.array([1, math.tan(bearing), 0, 0.08, 0.4], np.float32)


class Follower:
    """Drives a simulated body clumsily after somebody who walks about in the distance."""

    def __init__(self, body, seed=0, period_s=0.1):
        self.body, self.period_s = body, period_s
        self.rng = np.random.default_rng(seed)
        self.state = response.initial(period_s=period_s)
        self.target = self.pace = 0.0
        self.drive = np.zeros(2, np.float32)

    def look(self):
        self.state = response.advance(self.state, sight(self.bearing), self.drive, self.period_s)
        return dict(zip(response.COLUMNS, response.told(self.state, self.period_s), strict=True))

    @property
    def bearing(self):
        return wrap_angle(self.target - self.body.pose.yaw)

    def step(self, turn):
        """Give a command and let it work for one period; the target walks on."""
        self.drive = np.array([0.3, turn], np.float32)
        yaw_rate = turn * self.body.settings.yaw_rate_rad_s
        self.body.step(Twist(vx=0.3, yaw_rate=yaw_rate), self.period_s)
        self.pace += 0.2 * math.sqrt(self.period_s) * self.rng.normal() - 0.3 * self.period_s * self.pace
        self.target += self.pace * self.period_s

    def follow(self, seconds):
        for _ in range(round(seconds / self.period_s)):
            told = self.look()
            self.step(float(np.clip(1.2 * self.bearing + 0.3 * self.rng.normal(), -1, 1)))
        return told


BODIES = st.builds(
    a_body,
    delay_s=st.sampled_from([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6]),
    lag_s=st.floats(0.0, 0.2),
    yaw_rate_rad_s=st.floats(1.0, 3.0),
)


@settings(max_examples=40)
@given(body=BODIES, seed=st.integers(0, 1 << 32), period_s=st.sampled_from([0.05, 0.1]))
def test_it_finds_how_late_a_body_obeys(body, seed, period_s):
    """Delay and a short lag can stand in for each other."""
    told = Follower(body, seed, period_s).follow(20.0)
    late_s = 0.6 * told["delay"] + told["lag"]
    assert late_s == pytest.approx(body.settings.delay_s + body.settings.lag_s, abs=0.2)


@pytest.mark.parametrize("delay_s", [0.0, 0.2, 0.4, 0.6])
def test_a_pure_delay_is_told_as_one(delay_s):
    told = Follower(a_body(delay_s)).follow(20.0)
    assert 0.6 * told["delay"] == pytest.approx(delay_s, abs=0.05)
    assert told["delay_spread"] < 0.1


def test_what_is_under_way_is_where_the_target_will_be():
    """A target that stands, and a body with a known delay: after the delay it is where it was told to be."""
    follower = Follower(a_body(delay_s=0.4, lag_s=0.15))
    follower.follow(20.0)
    follower.pace, follower.target = 0.0, follower.body.pose.yaw + 0.4
    for _ in range(3):
        follower.look()
        follower.step(0.5)
    told = follower.look()
    for _ in range(4):  # what it is told now works after the delay
        follower.step(0.0)
        follower.pace = 0.0
    assert told["bearing_then"] * math.radians(60) == pytest.approx(follower.bearing, abs=0.06)
    assert told["turn_under_way"] > 0.1


def test_across_a_gap_the_turn_adds_up():
    follower = Follower(a_body(delay_s=0.2))
    follower.follow(20.0)
    follower.look()
    for _ in range(5):
        follower.pace = 0.0
        follower.step(-0.5)
        follower.state = response.advance(follower.state, UNSEEN, follower.drive, 0.1)
    told = dict(zip(response.COLUMNS, response.told(follower.state, 0.1), strict=True))
    for _ in range(2):  # the delay
        follower.pace = 0.0
        follower.step(0.0)
    assert told["bearing_then"] * math.radians(60) == pytest.approx(follower.bearing, abs=0.08)


@pytest.mark.parametrize("delay_s", [0.0, 0.5])
def test_the_targets_own_pace_is_told_however_late_the_body_turns(delay_s):
    follower = Follower(a_body(delay_s))
    follower.follow(20.0)
    paces, told = [], []
    for _ in range(200):
        told.append(follower.look()["pace"])
        paces.append(follower.pace / 2.0)
        follower.step(float(np.clip(1.2 * follower.bearing + 0.3 * follower.rng.normal(), -1, 1)))
    smoothed = np.convolve(paces, np.exp(-np.arange(10) / 3), "full")[:200] / np.exp(-np.arange(10) / 3).sum()
    assert np.corrcoef(told[10:], smoothed[10:])[0, 1] > 0.8


def test_a_body_that_changes_is_found_again():
    follower = Follower(a_body(delay_s=0.1))
    follower.follow(20.0)
    later = a_body(delay_s=0.5)
    later.place(follower.body.pose)
    follower.body = later
    assert 0.6 * follower.follow(40.0)["delay"] == pytest.approx(0.5, abs=0.1)


def test_without_a_target_nothing_is_known():
    state = response.initial(period_s=0.1)
    for _ in range(50):
        state = response.advance(state, UNSEEN, np.float32([1, -1]), 0.1)
    likely, gain = response.likelihood(state)
    np.testing.assert_allclose(likely, 1 / len(likely), rtol=1e-5)
    np.testing.assert_allclose(gain, YAW_RAD_S, rtol=1e-5)
    assert response.told(state, 0.1)[response.COLUMNS.index("evidence")] == 0


@settings(max_examples=30)
@given(seed=st.integers(0, 1 << 32))
def test_many_at_once_are_told_what_each_is_alone(seed):
    rng = np.random.default_rng(seed)
    sights = np.zeros((60, 3, 5), np.float32)
    sights[..., 0] = rng.random((60, 3)) < 0.8
    sights[..., 1:3] = rng.uniform(-1, 1, (60, 3, 2))
    sights[..., 3:] = rng.uniform(0, 0.5, (60, 3, 2))
    sights *= sights[..., :1]
    drives = rng.uniform(-3, 3, (60, 3, 2)).astype(np.float32)
    together, alone = (
        over_time(sights[:, one], drives[:, one], believes=False, responds=True, period_s=0.1).response
        for one in (slice(None), 1)
    )
    np.testing.assert_allclose(together[:, 1], alone, atol=1e-4)
    assert np.isfinite(together).all()
    told = dict(zip(response.COLUMNS, np.moveaxis(together, -1, 0), strict=True))
    assert all(np.abs(told[name]).max() <= 1.0 for name in ("evidence", "delay", "delay_spread", "driving"))
    assert max(np.abs(told[name]).max() for name in ("lag", "lag_spread", "pace", "drive_under_way")) <= 1.5
    assert together.dtype == np.float32


def test_episodes_that_begin_anew_forget_alone():
    one, other = (
        response.advance(
            response.initial(3, period_s=0.1), np.tile(sight(b), (3, 1)), np.ones((3, 2), np.float32), 0.1
        )
        for b in (0.1, 0.2)
    )
    mixed = response.kept_where(np.array([True, False, True]), one, other)
    assert mixed.bearing[:, 0] == pytest.approx([0.1, 0.2, 0.1])
    assert mixed.commands.shape == one.commands.shape
