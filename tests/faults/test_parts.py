"""Parts go wrong while their fault is on, say when it took effect, and are themselves again afterwards."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from adatracker_deploy.core.messages import Action
from adatracker_deploy.faults.parts import FaultyPolicy, FaultySegmenter, FrozenCamera, Switch


@pytest.fixture
def struck():
    return []


@pytest.fixture
def switch(struck):
    return Switch(struck.append)


class Whole:
    """A policy, segmenter and camera that answers with how often it was asked."""

    needs_truth = True
    info = SimpleNamespace(name="whole", rate_hz=10.0)

    def __init__(self):
        self.asked = 0

    def reset(self, seed=0):
        self.asked = 0

    open = close = go = reset

    def __call__(self, frame):
        self.asked += 1
        return frame, self.asked

    def act(self, observation):
        self.asked += 1
        return Action(np.array([0.25, -0.5], np.float32), np.zeros(3, np.float32))

    def read(self, now_ns):
        return now_ns


@pytest.mark.parametrize(
    ("fault", "answers"),
    [
        ("policy_nan", [[np.nan, np.nan]] * 2),
        ("policy_inf", [[np.inf, np.inf]] * 2),
        ("action_jump", [[-1, -1], [1, 1]]),
    ],
)
def test_a_policy_answers_wrongly_and_keeps_its_memory_going(switch, struck, fault, answers):
    whole = Whole()
    policy = FaultyPolicy(whole, switch)
    switch.begin(fault)
    assert struck == []  # it has not been asked yet
    for answer in answers:
        action = policy.act(None)
        np.testing.assert_array_equal(action.values, np.array(answer, np.float32))
        assert action.values.dtype == np.float32
        assert action.context is not None
    assert struck == [fault]
    switch.end(fault)
    np.testing.assert_array_equal(policy.act(None).values, [0.25, -0.5])
    assert (whole.asked, policy.info) == (3, Whole.info)


def hangs_until_over(switch, struck, fault, call):
    answered = threading.Event()
    switch.begin(fault)
    thread = threading.Thread(target=lambda: (call(), answered.set()))
    thread.start()
    while not struck:
        pass
    assert not answered.is_set()
    switch.end(fault)
    thread.join(10)
    assert answered.is_set()


def test_a_segmenter_stalls_until_it_is_over_and_fails_at_once(switch, struck):
    segmenter = FaultySegmenter(Whole(), switch)
    assert segmenter.needs_truth
    hangs_until_over(switch, struck, "segmenter_stall", lambda: segmenter("frame"))
    assert segmenter("next") == ("next", 2)
    switch.begin("segmenter_error")
    with pytest.raises(RuntimeError, match="segmenter_error"):
        segmenter("frame")


def test_a_policy_hangs_until_it_is_over(switch, struck):
    policy = FaultyPolicy(Whole(), switch)
    hangs_until_over(switch, struck, "policy_hang", lambda: policy.act(None))


def test_a_camera_freezes_on_its_last_frame_and_thaws(switch, struck):
    camera = FrozenCamera(Whole(), switch)
    switch.begin("camera_freeze")
    assert camera.read(1) == 1  # there is none yet to freeze on
    assert (camera.read(2), camera.read(3)) == (1, 1)
    assert struck == ["camera_freeze"]
    switch.end("camera_freeze")
    assert camera.read(4) == 4
