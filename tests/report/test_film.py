"""A trial as a film, from whole logs and from what is left of others."""

from __future__ import annotations

import itertools
import json

import cv2
import numpy as np
import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import Twist
from adatracker_deploy.perception.capture import Capture
from adatracker_deploy.perception.overlay import shown_size
from adatracker_deploy.report.film import film_rate_hz, shots
from adatracker_deploy.trial.reader import read_trial
from tests.report.pages import write_trial
from tests.trial.records import START_NS, TICK_NS, a_frame, a_log, a_step, a_trial, an_observation

NUMBERS = itertools.count()


def filmed(path):
    """The brightness of a film's frames, and its rate."""
    film, found = Capture(str(path)), []
    while film.grab():
        found.append(float(film.rgb().mean()))
    rate_hz = film.rate_hz
    film.close()
    return found, rate_hz


def test_every_tick_is_a_frame_at_its_time(tmp_path, capsys):
    folder = a_trial(tmp_path, [a_step(step) for step in range(12)])
    out = tmp_path / "trial.mp4"
    assert main(["film", str(folder), "--out", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"out": str(out), "frames": 12, "rate_hz": 20.0}
    found, rate_hz = filmed(out)
    assert len(found) == 12
    assert rate_hz == pytest.approx(20)
    assert main(["film", str(folder), "--out", str(out)]) == 0
    assert capsys.readouterr().out == f"{out}\n"


def pictures(folder):
    return list(shots(read_trial(folder)))


def picture(folder, step, config=None):
    (shot,) = pictures(write_trial(folder, [step], config=config))
    return shot.picture


def test_what_is_drawn_is_what_the_log_says(tmp_path):
    def drawn(**changes):
        return picture(tmp_path / f"trial {next(NUMBERS)}", a_step(0, **changes))

    usual = drawn()
    assert usual.shape[1::-1] == shown_size(160, 120)
    assert np.array_equal(usual, drawn())
    others = [
        drawn(**changes)
        for changes in (
            {"box": None},
            {"target": "lost", "box": None},
            {"target": "coasting", "box": None},
            {"confidence": 0.5},
            {"sent": Twist(vx=0.4, yaw_rate=0.5)},
            {"stale": True, "box": None, "action": ()},
            {"sent": None},
        )
    ]
    assert not any(np.array_equal(one, other) for one, other in itertools.combinations([usual, *others], 2))


def test_what_was_sent_is_shown_in_shares_of_the_robots_limits(tmp_path):
    def drawn(sent, **limits):
        folder, config = tmp_path / f"trial {next(NUMBERS)}", {"profile": {"limits": limits}}
        return picture(folder, a_step(0, sent=sent), config)

    half = drawn(Twist(vx=0.5), forward_m_s=1.0)
    assert np.array_equal(half, drawn(Twist(vx=1.0), forward_m_s=2.0))
    assert not np.array_equal(half, drawn(Twist(vx=1.0), forward_m_s=1.0))


def test_ticks_that_saw_the_same_frame_share_it_and_lost_frames_are_skipped(tmp_path):
    with a_log(tmp_path) as log:
        for step, seq in enumerate((0, 0, 1, 5, 5, 7)):
            if seq == 5:
                log._last_seq = 5  # as if its picture had been dropped
            log.step(a_step(step, frame_seq=seq), a_frame(seq), an_observation(seq))
    assert [shot.t_ns for shot in pictures(log.folder)] == [
        START_NS + step * TICK_NS for step in (0, 1, 2, 5)
    ]
    out = tmp_path / "trial.mp4"
    assert main(["film", str(log.folder), "--out", str(out)]) == 0
    assert len(filmed(out)[0]) == 6  # the picture before stands meanwhile


def test_a_log_that_was_cut_short_is_filmed_as_far_as_it_goes(tmp_path):
    folder = a_trial(tmp_path, [a_step(step) for step in range(10)])
    whole = (folder / "trial.mcap").read_bytes()
    (folder / "trial.mcap").unlink()
    (folder / "trial.mcap.part").write_bytes(whole[: len(whole) // 2])
    assert 0 < len(pictures(folder)) < 10


@pytest.mark.parametrize("size", [(480, 640), (1921, 1079), (64, 64)])
def test_pictures_of_any_size_make_a_film(tmp_path, size):
    width, height = size
    with a_log(tmp_path) as log:
        for step in range(2):
            log.step(a_step(step), a_frame(step, width, height), an_observation(step, 64, 64))
    out = tmp_path / "trial.mp4"
    assert main(["film", str(log.folder), "--out", str(out)]) == 0
    film = cv2.VideoCapture(str(out))
    shown = film.get(cv2.CAP_PROP_FRAME_WIDTH), film.get(cv2.CAP_PROP_FRAME_HEIGHT)
    film.release()
    assert shown == shown_size(width, height)


def test_a_single_tick_has_a_rate_too(tmp_path):
    assert film_rate_hz(read_trial(a_trial(tmp_path, [a_step(0)]))) == 1


def test_a_log_without_frames_is_refused(tmp_path):
    with a_log(tmp_path) as log:
        pass
    with pytest.raises(UsageError, match="no camera frames"):
        pictures(log.folder)
    assert main(["film", str(log.folder), "--out", str(tmp_path / "trial.mp4")]) == 2
    assert not (tmp_path / "trial.mp4").exists()


@pytest.mark.parametrize("out", ["trial.avi", "nowhere/trial.mp4"])
def test_a_wrong_request_exits_with_2(tmp_path, capsys, out):
    folder = a_trial(tmp_path, [a_step(0)])
    assert main(["film", str(folder), "--out", str(tmp_path / out)]) == 2
    assert "--out" in capsys.readouterr().err
