"""Episodes that are seen through pictures."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import Box, MaskClass, Observation
from adatracker_deploy.evaluation import eyes as eyes_module
from adatracker_deploy.evaluation.eyes import FIRST_SIGHT_S, Eyes, check_eyes
from adatracker_deploy.evaluation.grid import EYES_ASPECT, Grid
from adatracker_deploy.evaluation.play import Episode, play
from adatracker_deploy.learning.conditions import make_cell
from adatracker_deploy.learning.tracking import Tracking
from adatracker_deploy.learning.view import vertical_fov_deg
from adatracker_deploy.policy.catalogue import load_policy

pytest.importorskip("panda3d", reason="needs the extra 'world'")

SPEC = make_cell("clean", 1.0, 0.5, 9_000_001, aspect=EYES_ASPECT)


class Blind:
    """Implements `Segmenter`: sees nobody, or after so many pictures somebody everywhere."""

    needs_truth = False

    def __init__(self, until=None):
        self.until, self.looked, self.resets = until, 0, 0

    def reset(self):
        self.resets += 1

    def __call__(self, frame):
        self.looked += 1
        there = self.until is not None and self.looked > self.until
        mask = np.full((48, 64), MaskClass.TARGET if there else MaskClass.BACKGROUND, np.uint8)
        return Observation(mask, Box(0.5, 0.5, 1.0, 1.0) if there else None, 0.0, frame.t_ns, frame.seq)


def task():
    tracking = Tracking(SPEC)
    tracking.begin()
    return tracking.task


def test_it_is_looked_for_while_the_robot_stands_and_then_given_up():
    blind = Blind()
    eyes = Eyes(task(), blind)
    assert eyes.first_sight() is None
    assert blind.looked == round(FIRST_SIGHT_S * 10)
    assert blind.resets == 1
    assert eyes.summary().seen == 0.0


def test_the_first_sight_is_what_the_policy_begins_with():
    eyes = Eyes(task(), Blind(until=5))
    seen = eyes.first_sight()
    assert seen.seq == 6
    assert seen.box is not None
    assert 0.0 < eyes.summary().seen < 0.5


def test_an_episode_without_a_first_sight_is_lost_at_once(monkeypatch):
    monkeypatch.setattr(eyes_module, "FIRST_SIGHT_S", 0.5)
    monkeypatch.setattr("adatracker_deploy.evaluation.play.eyes_of", lambda name: Blind())
    played = play(load_policy("pid"), Episode(policy="pid", spec=SPEC, steps=20, segmenter="embedded"))
    assert (played.ar, played.el, played.success) == (0.0, 0, False)


def test_the_shipped_eyes_follow_the_target():
    played = play(load_policy("pid"), Episode(policy="pid", spec=SPEC, steps=30, segmenter="embedded"))
    assert played.success
    assert played.ar > 20
    assert played.sights.seen > 0.8
    assert played.sights.wrong == 0.0
    assert played.sights.mask_iou > 0.6


def test_what_looks_at_no_pictures_is_refused():
    for name in ("truth", "noisy"):
        with pytest.raises(UsageError, match="looks at no pictures"):
            check_eyes(name)
    with pytest.raises(UsageError, match="segmenter 'nonsense'"):
        Grid(policies=("pid",), segmenter="nonsense")


def test_the_truth_s_grid_is_the_paper_s_and_the_eyes_is_not():
    assert Grid(policies=("pid",)).is_the_papers
    assert not Grid(policies=("pid",), segmenter="embedded").is_the_papers


class Clicked(Blind):
    """Remembers where the operator clicked, and takes the third click."""

    def __init__(self):
        super().__init__()
        self.clicks = []

    def __call__(self, frame):
        if frame.click is not None:
            self.clicks.append((frame.click, frame.seq))
        self.until = 0 if len(self.clicks) >= 3 else None
        return super().__call__(frame)


def test_the_operator_clicks_on_the_middle_of_the_target_until_it_is_followed_and_not_again():
    clicked = Clicked()
    eyes = Eyes(task(), clicked)
    seen = eyes.first_sight()
    assert seen.seq == len(clicked.clicks) == 3
    for click, seq in clicked.clicks:
        assert click.seq == seq
        assert click.x == pytest.approx(0.5, abs=0.05)  # the robot stands 2.5 m behind the target
        assert 0.3 < click.y < 0.8
    eyes.look()
    assert len(clicked.clicks) == 3


def test_the_shipped_eyes_begin_with_whom_the_operator_means_although_somebody_else_is_larger():
    """The target's legs are below the picture; somebody else, further off, fills more of it."""
    spec = make_cell("field", 3.0, 3.0, 13_470_000)  # its camera is pitched for a square
    spec = replace(spec, embodiment=replace(spec.embodiment, aspect=EYES_ASPECT))
    tracking = Tracking(spec)
    tracking.begin()
    eyes = Eyes(tracking.task, eyes_module.eyes_of("embedded"))
    eyes.first_sight()
    assert eyes.summary().wrong == 0.0
    assert eyes.summary().seen > 0.0


def test_bodies_that_see_through_pictures_have_the_target_in_view_in_these():
    for episode in Grid(policies=("pid",), condition="field", episodes=1, segmenter="embedded").plan():
        body = episode.spec.embodiment
        assert body.aspect == EYES_ASPECT == 0.75
        assert Tracking(episode.spec).begin().box is not None
        down = math.degrees(math.atan2(body.height_m - 1.3, 2.5))
        assert abs(down - body.pitch_deg) <= 0.45 * vertical_fov_deg(body.fov_deg, body.aspect) + 1e-6


def test_masks_of_the_truth_are_square_unless_asked_otherwise():
    for grid, aspect in ((Grid(policies=("pid",)), 1.0), (Grid(policies=("pid",), aspect=0.75), 0.75)):
        assert {episode.spec.embodiment.aspect for episode in grid.plan()} == {aspect}
        assert grid.is_the_papers == (aspect == 1.0)
    with pytest.raises(UsageError, match=r"aspect: 2 is out of range \[0.25, 1\]"):
        Grid(policies=("pid",), aspect=2)
