"""Two sets of trials: differences, tests, words, and what cannot be compared."""

from __future__ import annotations

import json

import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.scoring.compare import compare
from adatracker_deploy.scoring.stats.intervals import mean_estimate
from tests.trial.records import a_step, a_trial

GOOD, BAD = (0.95, 0.93, 0.96, 0.94, 0.92), (0.45, 0.40, 0.62, 0.51, 0.33)


def rows(mrs, els=None, *, horizon=600, seeds=None, **changes):
    els = els or [horizon] * len(mrs)
    return [
        {
            "trial": f"trial {number}",
            "platform": "drone",
            "policy": "pid",
            "outcome": "completed" if el == horizon else "lost",
            "mr": mr,
            "el": el,
            "ar": None,
            "steps": horizon,
            "rate_hz": 20.0,
            "seconds": el / 20,
            "episode": seeds and {"seed": seeds[number], "scene": "simple_room", "target_speed_m_s": 1.0},
            **changes,
        }
        for number, (mr, el) in enumerate(zip(mrs, els, strict=True))
    ]


def by_metric(found):
    return {each.metric: each for each in found.differences}


def test_five_clear_trials_a_side_are_told_apart_in_words():
    found = by_metric(compare(rows(BAD, [300, 250, 600, 420, 200]), rows(GOOD)))
    mr, el, sr = found["mr"], found["el"], found["sr"]
    assert mr.estimate.value == pytest.approx(sum(GOOD) / 5 - sum(BAD) / 5)
    assert mr.test.p == 2 / 252
    assert mr.words == "MR: B's is higher by 0.48 (p = 0.0079, permutation test)"
    assert el.unit == "steps"
    assert "EL: B's is higher by 246 steps" in el.words
    assert sr.test.p == pytest.approx(2 * (5 + 1) / 252)  # 5/5 against 1/5: 1 and 5 of 252 ways, both ends
    assert sr.words.startswith("SR: B's is higher by 0.80")


def test_what_five_trials_cannot_tell_is_said():
    found = by_metric(compare(rows([0.9] * 5, [600, 600, 90, 80, 70]), rows([0.9] * 5)))
    assert found["sr"].test.p == pytest.approx(1 / 6)
    assert found["sr"].words.startswith("SR: not separable at n = 5 (p = 0.17, Fisher's exact test)")
    assert found["mr"].words.endswith("every trial came out the same")
    assert by_metric(compare(rows([0.94, 0.8]), rows(GOOD)))["mr"].words.startswith(
        "MR: not separable at n = 2 and 5"
    )


def test_equal_rehearsals_are_compared_in_pairs_whatever_their_order():
    ours, theirs = rows(BAD, seeds=[1, 2, 3, 4, 5]), rows(GOOD[::-1], seeds=[5, 4, 3, 2, 1])
    found = compare(ours, theirs)
    assert found.paired
    mr = by_metric(found)["mr"]
    assert (mr.method, mr.test.p) == ("sign_flip", 0.0625)
    assert mr.estimate == mean_estimate([b - a for a, b in zip(BAD, GOOD, strict=True)])
    assert "not separable at n = 5" in mr.words
    assert "cannot give p < 0.062, whatever they show" in mr.words
    assert by_metric(found)["sr"].method == "fisher"


@pytest.mark.parametrize("seeds", [None, [1, 2, 3, 4, 6], [1, 1, 2, 3, 4]])
def test_without_a_partner_for_every_trial_they_are_two_sets(seeds):
    assert not compare(rows(BAD, seeds=[1, 2, 3, 4, 5]), rows(GOOD, seeds=seeds)).paired
    assert not compare(rows(BAD, seeds=seeds), rows(GOOD, seeds=[1, 2, 3, 4, 5])).paired


def test_another_scene_or_robot_is_no_partner():
    ours, seeds = rows(BAD, seeds=[1, 2, 3, 4, 5]), [1, 2, 3, 4, 5]
    assert not compare(ours, rows(GOOD, seeds=seeds, platform="wheeled")).paired
    elsewhere = [
        row | {"episode": row["episode"] | {"scene": "urban_road"}} for row in rows(GOOD, seeds=seeds)
    ]
    assert not compare(ours, elsewhere).paired


def test_pairs_are_by_order_or_not_at_all_when_asked():
    seeds = [1, 2, 3, 4, 5]
    assert compare(rows(BAD), rows(GOOD), pairing="order").paired
    assert not compare(rows(BAD, seeds=seeds), rows(GOOD, seeds=seeds), pairing="none").paired
    with pytest.raises(UsageError, match="A has 5 trials, B 2"):
        compare(rows(BAD), rows([0.5, 0.6]), pairing="order")


def test_different_rates_are_compared_over_time_and_a_sum_over_steps_is_not():
    slow = rows(GOOD, rate_hz=10.0, seconds=60.0)
    found = compare(rows(BAD, ar=300.0), [row | {"ar": 300.0} for row in slow])
    el = by_metric(found)["el"]
    assert (el.unit, el.means, el.estimate.value) == ("s", (30.0, 60.0), 30.0)
    assert set(by_metric(found)) == {"mr", "el", "sr"}
    assert "different rates (10.0 to 20.0 Hz): EL is compared in seconds" in found.notes[0]
    assert "like for like only with horizons of equal seconds" in found.notes[0]
    assert compare(rows(BAD), rows(GOOD, rate_hz=19.2)).notes == compare(rows(BAD), rows(GOOD)).notes


def test_an_unknown_rate_is_no_equal_rate_but_all_unknown_are_alike():
    unknown = rows(GOOD, rate_hz=None, seconds=None)
    with pytest.raises(UsageError, match="EL has no seconds: give it with --rate HZ"):
        compare(rows(BAD), unknown)
    assert compare(unknown, unknown).differences[1].unit == "steps"
    died_at_once = rows([0.0], [0], rate_hz=None, seconds=0.0)
    assert compare(rows(BAD), [*rows(GOOD), *died_at_once]).differences


def late(trials, *places):
    return [row | {"counted": place not in places} for place, row in enumerate(trials)]


def test_trials_whose_timing_was_not_kept_are_left_out_and_that_is_said():
    found = compare(rows(BAD), late(rows([*GOOD, 0.1]), 5))
    assert by_metric(found)["mr"].counts == (5, 5)
    assert by_metric(found)["mr"].means[1] == pytest.approx(sum(GOOD) / 5)
    assert found.notes[0].startswith("1 trials are left out")
    with pytest.raises(UsageError, match=r"B: no trial kept its timing.*--all"):
        compare(rows(BAD), late(rows(GOOD), 0, 1, 2, 3, 4))


def test_a_pair_of_which_one_trial_is_late_is_left_out_and_the_others_stay_pairs():
    found = compare(late(rows(BAD), 1), late(rows(GOOD), 3), pairing="order")
    less = [GOOD[place] - BAD[place] for place in (0, 2, 4)]
    assert found.paired
    assert by_metric(found)["mr"].estimate == mean_estimate(less)


def test_notes_say_what_must_be_known_first():
    notes = " ".join(compare(rows(BAD), rows([0.9], horizon=500, platform="wheeled")).notes)
    assert "planned horizons differ, 500 to 600 steps" in notes
    assert "A drone; B wheeled" in notes
    assert "5 of 5 trials of A and 1 of 1 of B" in notes
    assert "a single trial" in notes


@pytest.fixture(scope="module")
def sets(tmp_path_factory):
    """Two policies on the same three rehearsals; B loses its target for the second half."""
    folder = tmp_path_factory.mktemp("sets")
    for name, seen in (("a", 11), ("b", 6)):
        for seed in range(3):
            steps = [a_step(step, box=a_step(0).box if step < seen - seed else None) for step in range(11)]
            config = {"seed": seed, "scene": "simple_room", "target_speed_m_s": 1.0}
            a_trial(folder / name / str(seed), steps, policy=name, config=config)
    return folder


def test_the_command_compares_folders(capsys, sets):
    assert main(["compare", str(sets / "a"), str(sets / "b"), "--json"]) == 0
    out, err = capsys.readouterr()
    record = json.loads(out)
    assert (out.count("\n"), err, record["paired"]) == (1, "", True)
    assert record["differences"]["mr"]["difference"] == pytest.approx(-0.5)
    assert record["differences"]["mr"]["p"] == record["differences"]["mr"]["least_p"] == 0.25
    assert record["a"]["mean"]["mr"] == pytest.approx(0.9)
    assert {"mr", "el", "sr", "ar"} == set(record["differences"])
    assert main(["compare", str(sets / "a"), str(sets / "b")]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "compared pair by pair" in text
    assert "MR of B: 0.50, 0.40, 0.30" in text
    assert "MR: not separable at n = 3" in text


def test_the_command_says_what_it_cannot_compare(capsys, sets, tmp_path):
    assert main(["compare", str(sets / "a"), str(tmp_path)]) == 2
    assert "no trials in it" in capsys.readouterr().err
    (tmp_path / "boxes.txt").write_text("1,1,2,2\n1,1,2,2\n")
    arguments = ["compare", str(sets / "a"), str(tmp_path), "--image-size", "9x9"]
    assert main(arguments) == 2
    assert "give it with --rate" in capsys.readouterr().err
    assert main([*arguments, "--rate", "20"]) == 0
    assert main([*arguments, "--rate", "5"]) == 0


def test_the_command_compares_a_policy_at_20_hz_with_one_at_10(capsys, sets, tmp_path):
    slow = [a_step(step, t_ns=a_step(0).t_ns + step * 100_000_000) for step in range(11)]
    a_trial(tmp_path, slow)
    assert main(["compare", str(sets / "a"), str(tmp_path)]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "EL (s)" in text
    assert "the trials ran at different rates (10.0 to 20.0 Hz): EL is compared in seconds" in text
    assert main(["compare", str(sets / "a"), str(tmp_path), "--any-rate"]) == 0  # which scripts may say
