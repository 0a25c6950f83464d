"""The page: what it shows, that it stands alone, and that nothing in a trial can break out of it."""

from __future__ import annotations

import base64
import dataclasses
import json
import re
import shutil

import cv2
import numpy as np
import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.core.record import BY_HAND, BY_POLICY
from adatracker_deploy.report.gather import gather, key_steps, moments
from adatracker_deploy.report.set_page import set_page
from adatracker_deploy.report.trial_page import trial_page
from tests.report.pages import HOSTILE, Page, a_hostile_trial, a_varied_trial, write_trial
from tests.trial.records import REFERENCE, a_step


def page_of(folder):
    report = gather(folder)
    return trial_page(report, moments(report.trial))


@pytest.fixture(scope="module")
def varied(tmp_path_factory):
    return a_varied_trial(tmp_path_factory.mktemp("trials") / "varied")


@pytest.fixture(scope="module")
def hostile(tmp_path_factory):
    return a_hostile_trial(tmp_path_factory.mktemp("hostile"))


@pytest.fixture(scope="module")
def pages(varied, hostile):
    """Pages of one trial, of a hostile one, and of both as a set."""
    return {
        "varied": page_of(varied),
        "hostile": page_of(hostile),
        "set": set_page([gather(varied), gather(hostile), gather(varied)]),
    }


@pytest.mark.parametrize("name", ["varied", "hostile", "set"])
def test_the_page_stands_alone_and_runs_nothing(pages, name):
    page = Page(pages[name])
    assert all(address.startswith("data:image/jpeg;base64,") for address in page.addresses())
    assert {tag for tag, _ in page.tags}.isdisjoint(
        {"script", "link", "iframe", "object", "embed", "base", "use"}
    )
    assert not [key for _, attributes in page.tags for key in attributes if key.startswith("on")]
    assert "url(" not in pages[name]
    assert "@import" not in pages[name]
    assert page.unclosed == []


@pytest.mark.parametrize("name", ["hostile", "set"])
def test_every_hostile_text_is_shown_as_text(pages, name):
    shown = HOSTILE.replace("\u202e", "\ufffd")
    page = Page(pages[name])
    assert shown.replace("_", " ") in page.text
    tags = [tag for tag, _ in Page(pages["varied"]).tags if tag == "img"]
    assert len([tag for tag, _ in page.tags if tag == "img"]) <= len(tags)


def test_every_place_of_a_hostile_trial_is_shown_once_escaped(pages):
    shown = HOSTILE.replace("\u202e", "\ufffd")
    text = Page(pages["hostile"]).text
    # Heading, reason, mode, target, event, and the table's name, policy, hash and its name, scene, camera.
    assert text.count(shown) >= 10
    assert "&lt;" not in text  # nothing was escaped twice


def test_it_says_how_the_trial_went(pages):
    text = Page(pages["varied"]).text
    for words in ("safety stop", "the base went silent", "of 60 steps", "the wind freshens", "+1.00 s"):
        assert words in text
    for heading in (
        "Timeline",
        "Tracking",
        "Action, command, motion",
        "Link and battery",
        "Latency",
        "Events",
    ):
        assert heading in text
    assert "target lost" in text
    assert "command withheld" in text


def test_it_says_what_each_stage_took_where_the_log_knows(pages, tmp_path):
    traced = dataclasses.replace(a_step(0).latency, capture_ms=4.25, perceive_ms=5.0, gate_ms=6.5)
    folder = write_trial(tmp_path / "traced", [a_step(number, latency=traced) for number in range(3)])
    text = Page(page_of(folder)).text
    assert "the link's next slot, and the gate" in text
    assert "6.5" in text
    assert "the link's next slot" not in Page(pages["varied"]).text


def test_it_says_what_the_log_lacks(pages):
    text = Page(pages["varied"]).text
    assert "3 of 61 steps" in text
    assert "Steps that are missing: 45 to 47." in text


def test_its_pictures_are_of_the_start_the_first_loss_the_return_and_the_end(pages, varied):
    found = {name: step.step for name, step in key_steps(gather(varied).trial.steps).items()}
    assert found == {"start": 0, "first loss": 20, "seen again": 30, "end": 60}
    images = [attributes for tag, attributes in Page(pages["varied"]).tags if tag == "img"]
    assert [image["alt"] for image in images] == [
        "start, 0 s",
        "first loss, 1 s",
        "seen again, 1.5 s",
        "end, 3 s",
    ]
    picture = np.frombuffer(base64.b64decode(images[3]["src"].partition(",")[2]), np.uint8)
    assert cv2.imdecode(picture, cv2.IMREAD_COLOR).shape[2] == 3


@pytest.mark.parametrize(
    ("boxes", "names"),
    [("", []), ("s", ["start", "end"]), ("ll", ["end"]), ("lsl", ["start", "first loss", "end"])],
)
def test_moments_that_never_came_are_left_out(boxes, names):
    steps = [a_step(at, **({"box": None} if kind == "l" else {})) for at, kind in enumerate(boxes)]
    assert list(key_steps(steps)) == names


def test_axes_that_a_robot_does_not_have_are_not_drawn(pages):
    text = Page(pages["varied"]).text
    assert "forward" in text
    assert "yaw" in text
    assert "upm/s" not in text


def test_a_log_of_a_single_tick_without_truth_or_telemetry_or_frames_has_a_page(tmp_path):
    bare = a_step(0, box=None, pose=None, velocity=None, battery=None, state_age_s=float("inf"), action=())
    bare = dataclasses.replace(bare, distance_m=None, bearing_rad=None, target_visible=None)
    text = Page(page_of(write_trial(tmp_path / "bare", [bare], frames=False))).text
    assert "The robot reports no battery." in text
    assert "No frames were logged." in text
    assert "distance" not in text


def test_a_log_without_a_step_has_a_page(tmp_path):
    text = Page(page_of(write_trial(tmp_path / "empty", []))).text
    assert "not a single step" in text
    assert "system fault" in text


def test_a_log_that_was_cut_short_says_so(varied, tmp_path):
    whole = (varied / "trial.mcap").read_bytes()
    part = tmp_path / "trial.mcap.part"
    part.write_bytes(whole[: len(whole) * 2 // 3])
    assert "This log was cut short" in Page(page_of(part)).text


def test_a_long_trial_is_drawn_with_few_points_and_says_so(tmp_path):
    steps = [a_step(number, frame_seq=0, confidence=number % 7 / 7) for number in range(1900)]
    page = page_of(write_trial(tmp_path / "long", steps, frames=False))
    assert "of each of 600 columns" in page
    assert max(len(path) for path in re.findall(r' d="([^"]*)"', page)) < 40_000


def test_a_set_shows_every_trial_its_groups_and_their_intervals(tmp_path):
    seen, lost = [a_step(number) for number in range(6)], [a_step(number, box=None) for number in range(4)]
    done = {"outcome": "completed"}
    folders = [write_trial(tmp_path / f"good {n}", seen, summary=done, planned=5) for n in range(3)]
    folders.append(
        write_trial(tmp_path / "bad", lost, summary={"outcome": "lost"}, policy="other", planned=5)
    )
    text = Page(set_page([gather(folder) for folder in folders])).text
    assert "4 trials, 3 completed" in text
    assert "1.000 [1.000, 1.000]" in text  # three equal trials bound their mean to a point
    assert "1.00 [0.44, 1.00]" in text  # Wilson, 3 of 3
    assert "n = 3, 3 reached the horizon" in text
    assert "drone, other: n = 1, 0 reached the horizon" in text
    assert all(folder.name in text for folder in folders)


def test_the_command_writes_one_page_of_a_trial_or_of_a_set(varied, tmp_path, capsys):
    out = tmp_path / "page.html"
    assert main(["report", str(varied), "--out", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "out": str(out), "trials": 1, "bytes": out.stat().st_size,
    }  # fmt: skip
    assert out.read_text().startswith("<!doctype html>")
    assert main(["report", str(varied), str(varied), "--out", str(out)]) == 0
    assert "2 trials" in out.read_text()


def test_a_bad_trial_is_told_and_left_out(varied, tmp_path, capsys):
    (tmp_path / "trial.mcap").write_bytes(b"nothing of the kind")
    assert main(["report", str(varied), str(tmp_path), "--out", str(tmp_path / "page.html")]) == 0
    assert "left out" in capsys.readouterr().err


@pytest.mark.parametrize("wrong", [["nowhere"], []])
def test_without_a_single_trial_it_exits_with_2(tmp_path, capsys, monkeypatch, wrong):
    monkeypatch.chdir(tmp_path)
    assert main(["report", *wrong]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "report.html").exists()


def test_a_page_that_cannot_be_written_exits_with_2(varied, tmp_path, capsys):
    assert main(["report", str(varied), "--out", str(tmp_path / "no" / "page.html")]) == 2
    assert "--out" in capsys.readouterr().err


def test_a_trial_whose_timing_was_not_kept_is_marked_and_left_out_of_a_sets_means(tmp_path, capsys):
    steps = [a_step(number) for number in range(12)]
    write_trial(tmp_path / "set" / "a", steps, summary={"outcome": "completed"})
    late = [
        a_step(number, box=None if number else REFERENCE, missed_deadlines=number) for number in range(12)
    ]
    folder = write_trial(tmp_path / "set" / "b", late, summary={"outcome": "completed"})
    out = tmp_path / "page.html"

    def page(*arguments):
        assert main(["report", *map(str, arguments), "--out", str(out)]) == 0
        return Page(out.read_text()).text

    assert "timing not kept" in page(folder)
    text = page(tmp_path / "set")
    assert "Left out of all means, for their timing was not kept: number 2." in text
    assert "n = 1" in text
    assert "n = 2" in page(tmp_path / "set", "--all")
    shutil.copytree(folder, tmp_path / "late" / "c")
    shutil.copytree(folder, tmp_path / "late" / "d")
    assert "number 1, 2." in page(tmp_path / "late")


def test_a_page_shows_stale_stretches_as_what_they_are(tmp_path):
    steps = [
        a_step(n, **({"stale": True, "box": None, "action": ()} if 20 <= n < 26 else {})) for n in range(60)
    ]
    report = gather(write_trial(tmp_path / "t", steps, summary={"outcome": "completed"}))
    text = Page(trial_page(report, moments(report.trial))).text
    assert "The target was never lost." in text
    assert "target lost" not in text
    assert "10%of the ticks: frames too old to act on" in text


def test_a_page_shows_who_drove_where_that_was_not_the_policy_as_ever(tmp_path):
    def shown(name, **changes):
        steps = [a_step(n, **(changes if 20 <= n < 26 else {})) for n in range(60)]
        return Page(page_of(write_trial(tmp_path / name, steps))).text

    assert "driver" not in shown("policy", driver=BY_POLICY)
    assert "driverpolicyhand" in shown("hand", driver=BY_HAND)
    assert "driverpolicypolicy, searching" in shown("search", driver=BY_POLICY, searching=True, box=None)
