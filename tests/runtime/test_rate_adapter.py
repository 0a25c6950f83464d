"""A policy is asked at its own rate, whatever the camera's."""

from __future__ import annotations

import numpy as np
import pytest

from adatracker_deploy.core.messages import Action, Observation
from adatracker_deploy.policy.base import FORWARD_YAW, PolicyInfo
from adatracker_deploy.runtime.rate_adapter import RateAdapter


class Counting:
    """A policy at 20 Hz that answers with the number of the frame it was given."""

    info = PolicyInfo(name="counting", rate_hz=20.0, action=FORWARD_YAW)

    def __init__(self):
        self.given = []

    def reset(self, seed=0):
        self.given.clear()

    def act(self, observation):
        self.given.append(observation.seq)
        return Action(np.full(2, observation.seq, np.float32))


def looked(rate_hz, frames, start_ns=123_456_789):
    """Return what a policy was given along so many frames, and the number that came out with each."""
    policy = Counting()
    cadence = RateAdapter(policy)
    actions = [cadence.act(at(start_ns + round(seq * 1e9 / rate_hz), seq)) for seq in range(frames)]
    return policy.given, [None if action is None else int(action.values[0]) for action in actions]


def at(t_ns, seq):
    return Observation(np.zeros((2, 2), np.uint8), None, 0.0, t_ns, seq)


def test_at_the_same_rate_every_frame_is_answered_with_itself():
    assert looked(20.0, 40) == (list(range(40)), list(range(40)))


def test_a_slower_camera_gives_the_same_frame_twice():
    given, out = looked(10.0, 5)
    assert given == [0, 0, 1, 1, 2, 2, 3, 3, 4]
    assert out == [0, 1, 2, 3, 4]


def test_a_quicker_camera_has_frames_that_the_policy_never_gets():
    given, out = looked(60.0, 10)
    assert given == [0, 3, 6, 9]
    assert out == [0, 0, 0, 3, 3, 3, 6, 6, 6, 9]


@pytest.mark.parametrize("rate_hz", [5.0, 24.0, 25.0, 29.97, 30.0, 120.0])
def test_a_minute_of_film_has_twenty_ticks_a_second(rate_hz):
    given, _ = looked(rate_hz, round(60 * rate_hz) + 1)
    assert abs(len(given) - 1200) <= 1
    assert given == sorted(given)


def test_after_a_gap_the_policy_was_not_asked_about_what_was_too_old():
    policy = Counting()
    cadence = RateAdapter(policy)
    cadence.act(at(0, 1))
    cadence.act(at(1_000_000_000, 2))
    assert policy.given == [1] * 5 + [2]  # ticks from 0 to 0.2 s, and that at 1.0 s
    cadence.act(at(2_010_000_000, 3))
    assert cadence.act(at(2_020_000_000, 4)) is None
    assert cadence.act(at(2_060_000_000, 5)) is not None
