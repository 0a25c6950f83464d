"""A trial as one picture."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.messages import Box
from adatracker_deploy.report.chart import BLUE
from adatracker_deploy.report.filmstrip import FRAME_PX, GREEN, LABEL_PX, LOST, RED, STALE, film_strip
from adatracker_deploy.trial.reader import read_trial
from tests.trial.records import a_frame, a_log, a_step, a_trial, an_observation


def shows(picture, colour):
    return bool((picture == colour).all(axis=-1).any())


def test_a_strip_shows_the_box_while_the_target_is_seen_and_shades_where_it_is_lost(tmp_path):
    seen = film_strip(read_trial(a_trial(tmp_path, [a_step(step) for step in range(10)])))
    lost = film_strip(read_trial(a_trial(tmp_path, [a_step(step, box=None) for step in range(10)])))
    assert (shows(seen, GREEN), shows(seen, LOST)) == (True, False)
    assert (shows(lost, GREEN), shows(lost, LOST)) == (False, True)


def test_more_frames_make_a_longer_strip_but_no_more_than_there_are(tmp_path):
    trial = read_trial(a_trial(tmp_path, [a_step(step) for step in range(5)]))
    widths = [film_strip(trial, frames).shape[1] for frames in (2, 5, 9)]
    assert widths[0] < widths[1] == widths[2]


def test_a_trial_of_a_single_tick_without_truth_can_be_drawn(tmp_path):
    trial = read_trial(a_trial(tmp_path, [a_step(0, distance_m=None, bearing_rad=None)]))
    assert film_strip(trial).dtype == np.uint8


def test_frames_that_were_dropped_leave_the_others_to_be_shown(tmp_path):
    with a_log(tmp_path) as log:
        for step in range(9):
            if step in (0, 4, 8):  # which three frames would be
                log._last_seq = step
            log.step(a_step(step), a_frame(step), an_observation(step))
    trial = read_trial(log.folder)
    assert trial.frame_seqs == {1, 2, 3, 5, 6, 7}
    assert (
        film_strip(trial, 3).shape
        == film_strip(read_trial(a_trial(tmp_path, map(a_step, range(9)))), 3).shape
    )


def test_a_log_without_frames_is_refused(tmp_path):
    with a_log(tmp_path) as log:
        pass
    with pytest.raises(UsageError, match="no camera frames"):
        film_strip(read_trial(log.folder))


def test_the_command_writes_a_png(tmp_path, capsys):
    folder = a_trial(tmp_path, [a_step(step) for step in range(5)])
    assert main(["filmstrip", str(folder), "--out", str(tmp_path / "strip.png")]) == 0
    assert cv2.imread(str(tmp_path / "strip.png")).shape[2] == 3
    assert capsys.readouterr().out == f"{tmp_path / 'strip.png'}\n"


@pytest.mark.parametrize("wrong", [["--frames", "0"], ["--out", "nowhere/strip.png"]])
def test_a_wrong_request_exits_with_2(tmp_path, capsys, wrong):
    folder = a_trial(tmp_path, [a_step(0)])
    assert main(["filmstrip", str(folder), *wrong]) == 2
    assert wrong[0] in capsys.readouterr().err


def test_a_stale_step_is_neither_drawn_as_lost_nor_as_seen(tmp_path):
    steps = [a_step(step, stale=True, box=None, action=()) for step in range(10)]
    strip = film_strip(read_trial(a_trial(tmp_path, [a_step(0), *steps[1:]])))
    assert (shows(strip, STALE), shows(strip, LOST)) == (True, False)


def test_a_wrong_sight_is_named_and_the_truth_is_drawn_beside_it(tmp_path):
    there, elsewhere = Box(0.7, 0.5, 0.1, 0.4), Box(0.3, 0.5, 0.1, 0.4)
    right = [a_step(step, box=there, true_box=there, sight="seen") for step in range(5)]
    wrong = [a_step(step, box=elsewhere, true_box=there, sight="somebody_else") for step in range(5)]
    folders = [a_trial(tmp_path / name, steps) for name, steps in (("right", right), ("wrong", wrong))]
    strips = [film_strip(read_trial(folder), 1) for folder in folders]
    frames = [strip[LABEL_PX : LABEL_PX + FRAME_PX] for strip in strips]
    columns = [np.flatnonzero((frame == GREEN).all(axis=-1).any(axis=0)).mean() for frame in frames]
    assert columns[1] < columns[0]  # where it was thought to be
    blue = [np.abs(frame.astype(int) - BLUE).sum(axis=-1) < 60 for frame in frames]  # a thin line, smoothed
    assert blue[1].any()
    labels = [strip[LABEL_PX + FRAME_PX : 2 * LABEL_PX + FRAME_PX] for strip in strips]
    assert [shows(label, RED) for label in labels] == [False, True]
