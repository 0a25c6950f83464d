"""A hand takes over from the policy in a rehearsal, gives back, and the trial is scored and replayed."""

from __future__ import annotations

import json

import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.core.messages import ZERO
from adatracker_deploy.core.record import BY_HAND, BY_POLICY
from adatracker_deploy.policy.base import to_twist
from adatracker_deploy.replay.trial_again import limits_of
from adatracker_deploy.runtime.teleop.event_file import EVENTS_NAME, read_events
from adatracker_deploy.runtime.teleop.hand import Hand
from adatracker_deploy.runtime.teleop.takeover import HAND_ACTION
from adatracker_deploy.trial.reader import read_trial
from tests.tiers import EXHAUSTIVE

from .conftest import COMMAND, Flight

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]
EVENTS = (
    '{"t_s": 2.0, "code": "forward", "value": 0.4}\n'
    '{"t_s": 2.0, "code": "yaw", "value": 0.3}\n'
    '{"t_s": 2.0, "code": "dead_man"}\n'
    '{"t_s": 3.5, "code": "dead_man", "value": 0}\n'
    '{"t_s": 4.5, "code": "give_back"}\n'
)


@EXHAUSTIVE
def test_a_takeover_is_logged_scored_and_comes_back_to_the_bit(tmp_path, capsys, measured):
    (tmp_path / "hand.jsonl").write_text(EVENTS)
    run = Flight(
        [
            *(*COMMAND, "--platform", "wheeled", "--sitl", "--segmenter", "truth", "--policy", "pid"),
            *("--seed", "1", "--steps", "130", "--teleop", "hand.jsonl", "--json"),
        ],
        tmp_path,
    )
    status, summary, err = run.end(timeout_s=150)
    assert (status, summary["outcome"], summary["ended"]["outcome"]) == (1, "takeover", "completed"), err
    assert "taken over by hand" in err
    assert "given back to the policy" in err
    (folder,) = (tmp_path / "trials").iterdir()
    trial = read_trial(folder)
    names = [step.driver for step in trial.steps]
    assert [a for a, b in zip(names, [None, *names], strict=False) if a != b] == [
        BY_POLICY,
        BY_HAND,
        BY_POLICY,
    ]
    taken = summary["takeovers"]
    assert (taken["count"], taken["by_hand"]) == (1, 1)
    assert taken["between_s"] == pytest.approx(4.0, abs=0.3)
    assert taken["between_m"] > 0.5
    released = trial.steps[0].t_ns + 3.5e9
    late = [
        (s.t_ns - released) / 1e9 for s in trial.steps if s.driver == BY_HAND and s.sent and s.sent != ZERO
    ]
    assert max(late) < 0.2
    measured(f"wheeled: the last moving command by hand {max(late):.2f} s after the release")

    events = read_events(folder / EVENTS_NAME)
    assert events == read_events(tmp_path / "hand.jsonl")
    hand, limits = Hand(None, None, recorded=events), limits_of(trial)
    for step in trial.steps:
        asked = hand.at(step.t_ns)
        assert asked.drives == (step.driver == BY_HAND)
        if asked.drives:
            assert step.command == (to_twist(asked.values, HAND_ACTION, limits) if asked.values else ZERO)

    assert main(["score", str(folder), "--json"]) == 0
    again = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert {key: again[key] for key in summary} == summary | {"trial": str(folder)}
    assert main(["replay", str(folder)]) == 0  # the policy's answers, also where they were not obeyed
    assert main(["mark", str(folder), "--outcome", "takeover", "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["takeovers"]["count"] == 1
    assert main(["report", str(folder), "--out", str(tmp_path / "page.html")]) == 0
    assert "asked by the driver" in (tmp_path / "page.html").read_text()
