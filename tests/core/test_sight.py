"""Each sight is judged by the truth: seen, somebody else, not trusted, not found, hidden or outside."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import MaskClass, Truth
from adatracker_deploy.core.sight import Verdict, judged

TARGET, PERSON = MaskClass.TARGET, MaskClass.PERSON
HERE, THERE, HALF = slice(2, 8), slice(12, 18), slice(5, 11)


def mask(*drawn):
    """Return a 20 x 20 mask with these (value, columns) in rows 4 to 16."""
    shown = np.zeros((20, 20), np.uint8)
    for value, columns in drawn:
        shown[4:16, columns] = value
    return shown


def truth(*drawn, in_view=True, scale=1):
    return Truth(
        mask=np.kron(mask(*drawn), np.ones((scale, scale), np.uint8)),
        robot=Pose(),
        camera=Pose(),
        target_xy=(2.5, 0.0),
        distance_m=2.5,
        bearing_rad=0.0,
        in_view=in_view,
    )


@pytest.mark.parametrize("scale", [1, 2, 3])
@pytest.mark.parametrize(
    ("seen", "true", "verdict"),
    [
        ([(TARGET, HERE)], [(TARGET, HERE)], Verdict.SEEN),
        ([(TARGET, HALF)], [(TARGET, HERE)], Verdict.SEEN),
        ([(TARGET, THERE)], [(TARGET, HERE)], Verdict.SOMEBODY_ELSE),
        ([(TARGET, THERE)], [(TARGET, HERE), (PERSON, THERE)], Verdict.SOMEBODY_ELSE),
        ([(TARGET, THERE), (PERSON, HERE)], [(TARGET, HERE), (PERSON, THERE)], Verdict.SOMEBODY_ELSE),
        ([(TARGET, THERE)], [], Verdict.SOMEBODY_ELSE),
        ([(PERSON, HERE)], [(TARGET, HERE)], Verdict.NOT_TRUSTED),
        ([(PERSON, THERE)], [(TARGET, HERE)], Verdict.NOT_FOUND),
        ([], [(TARGET, HERE)], Verdict.NOT_FOUND),
        ([], [(PERSON, HERE)], Verdict.HIDDEN),
    ],
)
def test_each_verdict(seen, true, verdict, scale):
    assert judged(mask(*seen), truth(*true, scale=scale)).verdict is verdict


def test_who_is_not_in_the_picture_is_outside_and_not_hidden():
    assert judged(mask(), truth(in_view=False)).verdict is Verdict.OUTSIDE
    assert judged(mask(), truth((TARGET, HERE), in_view=False)).verdict is Verdict.NOT_FOUND


def test_the_overlap_and_the_true_box():
    sight = judged(mask((TARGET, HALF)), truth((TARGET, HERE)))
    assert sight.mask_iou == pytest.approx(3 / 9)
    assert dataclasses.astuple(sight.true_box) == pytest.approx((0.25, 0.5, 0.3, 0.6))
    assert judged(mask(), truth()).mask_iou == 0.0
    assert judged(mask(), truth()).true_box is None


@given(
    arrays.arrays(np.uint8, (8, 12), elements=st.integers(0, 3)),
    arrays.arrays(np.uint8, st.tuples(st.integers(1, 30), st.integers(1, 30)), elements=st.integers(0, 3)),
    st.booleans(),
)
def test_any_two_masks_have_a_verdict_and_the_truth_itself_is_seen(seen, true, in_view):
    known = dataclasses.replace(truth(in_view=in_view), mask=true)
    assert 0.0 <= judged(seen, known).mask_iou <= 1.0
    itself = judged(true, known)
    if (true == TARGET).any():
        assert (itself.verdict, itself.mask_iou) == (Verdict.SEEN, 1.0)
