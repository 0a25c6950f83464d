"""Every reason of the gate says once what it does to a command, and whoever tells of it asks there."""

from __future__ import annotations

import enum
import pickle

import pytest

from adatracker_deploy.report.columns import columns
from adatracker_deploy.runtime.gate import Kind, Reason
from adatracker_deploy.runtime.gate.reasons import limited, withheld
from tests.trial.records import a_step


@pytest.mark.parametrize("reason", Reason)
def test_a_report_says_of_each_reason_what_the_gate_says_of_it(reason):
    cols = columns([a_step(0, gate=(reason.value,))])
    assert cols.limited.tolist() == [reason.kind is Kind.LIMITS]
    assert cols.stopped.tolist() == [reason.kind in {Kind.WITHHOLDS, Kind.STOPS}]


def test_smoothing_and_the_ramp_of_normal_driving_withhold_nothing():
    names = ("envelope", "ramp", "acceleration", "jerk")
    assert limited(names)
    assert not withheld(names)


def test_a_reason_not_known_here_counts_as_withheld_and_none_as_nothing():
    assert withheld(("a reason to come",))
    assert not withheld(())
    assert not limited(())


def test_a_reason_without_a_kind_cannot_be_made():
    with pytest.raises(TypeError, match="kind"):

        class Another(enum.StrEnum):
            __new__ = Reason.__new_member__
            NEW = "new"


def test_a_reason_is_its_name_in_status_logs_and_profiles():
    assert [Reason(reason.value) for reason in Reason] == list(Reason)
    assert f"{Reason.TOO_CLOSE}" == "too_close" == Reason.TOO_CLOSE
    assert pickle.loads(pickle.dumps(Reason.JERK)) is Reason.JERK
