"""A trial that ends for want of sight says why the target was not seen."""

from __future__ import annotations

import numpy as np
import pytest

from adatracker_deploy.core.messages import Box, Frame, MaskClass, Observation, Seen
from adatracker_deploy.core.sight import Sight, Verdict
from adatracker_deploy.runtime.unseen import NOBODY, PEOPLE, Unseen


def seen(verdict=None, box=None, people=False):
    mask = np.zeros((4, 4), np.uint8)
    mask[0, 0] = MaskClass.PERSON if people else MaskClass.BACKGROUND
    sight = None if verdict is None else Sight(verdict, 0.0, None)
    frame = Frame(np.zeros((4, 4, 3), np.uint8), 0, 0)
    return Seen(frame, Observation(mask, box, 0.0, 0, 0), sight=sight)


def test_the_causes_are_told_the_most_frequent_first():
    unseen = Unseen()
    for verdict in [Verdict.OUTSIDE] * 3 + [Verdict.NOT_FOUND] * 5:
        unseen.add(seen(verdict))
    assert unseen.steps == 8
    assert str(unseen) == (
        "the target was not seen for 8 steps: in the picture but not found in 5, outside the picture in 3"
    )


def test_a_sight_of_the_target_begins_anew():
    unseen = Unseen()
    unseen.add(seen(Verdict.HIDDEN))
    unseen.add(seen(Verdict.SEEN, box=Box(0.5, 0.5, 0.1, 0.1)))
    assert unseen.steps == 0
    unseen.add(seen(Verdict.OUTSIDE))
    assert str(unseen).endswith("for 1 steps: outside the picture in 1")


@pytest.mark.parametrize(("people", "words"), [(True, PEOPLE), (False, NOBODY)])
def test_without_a_truth_it_is_said_who_was_in_sight_instead(people, words):
    unseen = Unseen()
    unseen.add(seen(people=people))
    assert str(unseen).endswith(f"{words} in 1")
