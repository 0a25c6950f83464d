"""A trial's perception is scored against the truth of each picture."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.sight import Verdict
from adatracker_deploy.scoring.sights import SightTally
from adatracker_deploy.scoring.summary_table import sight_text
from tests.trial.records import REFERENCE, TICK_NS, a_step, any_steps


def tallied(*verdicts, **changes):
    """Return the summary of one tick per verdict; hidden and outside ticks have no true box."""
    tally = SightTally()
    for number, verdict in enumerate(verdicts):
        hidden = verdict in (Verdict.HIDDEN, Verdict.OUTSIDE)
        sight = {
            "sight": verdict.value,
            "true_box": None if hidden else REFERENCE,
            "mask_iou": 0.8 if verdict is Verdict.SEEN else 0.0,
            "box": REFERENCE if verdict in (Verdict.SEEN, Verdict.SOMEBODY_ELSE) else None,
        }
        tally.add(a_step(number, **(sight | changes)))
    return tally.summary()


def test_without_a_truth_there_is_nothing_to_say():
    tally = SightTally()
    tally.add(a_step(0))
    assert tally.summary() is None


def test_the_shares_of_each_verdict():
    found = tallied(
        *[Verdict.SEEN] * 6, Verdict.NOT_FOUND, Verdict.SOMEBODY_ELSE, Verdict.HIDDEN, Verdict.OUTSIDE
    )
    assert found["seen"] == pytest.approx(6 / 8)
    for verdict in (Verdict.NOT_FOUND, Verdict.SOMEBODY_ELSE, Verdict.HIDDEN, Verdict.OUTSIDE):
        assert found[verdict.value] == pytest.approx(0.1)
    assert found["not_trusted"] == 0.0
    assert found["mask_iou"] == pytest.approx(0.8)
    assert found["box_iou"] == pytest.approx(1.0)
    assert found["mr_true"] == pytest.approx(7 / 9)  # R is 1 where it shows, the first is the reference


def test_how_long_a_target_in_the_picture_was_not_seen():
    seen, missed, hidden = Verdict.SEEN, Verdict.NOT_FOUND, Verdict.HIDDEN
    found = tallied(seen, missed, missed, seen, hidden, hidden, hidden, seen, hidden, missed, seen)
    tick_s = TICK_NS / 1e9
    assert found["found_again_s"] == {
        "times": 2,
        "p50": pytest.approx(1.5 * tick_s),
        "max": pytest.approx(2 * tick_s),
    }


def test_stale_ticks_are_no_sights():
    assert tallied(Verdict.SEEN, Verdict.NOT_FOUND, stale=True) is None


def test_in_words():
    text = sight_text(tallied(*[Verdict.SEEN] * 9, Verdict.NOT_TRUSTED))
    assert text.startswith("target seen in 90.0% of where it was, found but not trusted 10.0%, mask IoU 0.80")
    assert "hidden" not in text


@given(st.lists(any_steps(), max_size=12))
def test_whatever_a_log_holds_it_is_summed_up(steps):
    tally = SightTally()
    for step in steps:
        tally.add(step)
    summary = tally.summary()
    json.dumps(summary, allow_nan=False)
    if summary is not None:
        assert sight_text(summary)
