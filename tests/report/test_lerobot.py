"""Trials as a LeRobotDataset: what is in its files, by pyarrow and OpenCV, which read both."""

from __future__ import annotations

import json
import sys

import cv2
import numpy as np
import pytest

from adatracker_deploy.cli import main
from adatracker_deploy.core.mask_png import PALETTE
from adatracker_deploy.report.lerobot.features import CAMERA, MASK
from adatracker_deploy.report.lerobot.statistics import PictureTally, of_numbers
from adatracker_deploy.trial.reader import read_trial
from tests.trial.records import a_frame, a_log, a_step, a_trial, an_observation

pq = pytest.importorskip("pyarrow.parquet", reason="needs the extra 'lerobot'")


def exported(*trials, out, more=()):
    assert main(["export", *map(str, trials), "--lerobot", str(out), *more]) == 0
    return json.loads((out / "meta/info.json").read_text())


def rows_of(out, file=0):
    return pq.read_table(out / f"data/chunk-000/file-{file:03d}.parquet").to_pydict()


def episodes_of(out):
    return pq.read_table(out / "meta/episodes/chunk-000/file-000.parquet").to_pylist()


def film_of(out, file=0):
    film = cv2.VideoCapture(str(out / f"videos/{CAMERA}/chunk-000/file-{file:03d}.mp4"))
    frames = []
    while film.grab():
        frames.append(cv2.cvtColor(film.retrieve()[1], cv2.COLOR_BGR2RGB))
    return frames


def classes(png):
    """Return the class ids of a painted mask."""
    rgb = cv2.cvtColor(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    return (rgb[:, :, None] == np.array(PALETTE)).all(-1).argmax(-1)


def test_every_row_is_a_tick_of_the_log(tmp_path, capsys):
    """A gap in the second trial makes two episodes of it."""
    first = a_trial(tmp_path / "a", [a_step(number) for number in range(4)])
    second = a_trial(
        tmp_path / "b", [a_step(number, stale=number == 3) for number in range(7)], {"outcome": "lost"}
    )
    info = exported(first, second, out=tmp_path / "set")
    assert capsys.readouterr() == (
        f"{tmp_path / 'set'}\n",
        "2 of 2 trials: 3 episodes, 7 rows; 4 ticks at ends and gaps left out\n",
    )
    assert (info["codebase_version"], info["fps"], info["total_frames"]) == ("v3.0", 20, 7)
    told = episodes_of(tmp_path / "set")
    spans = [(one["dataset_from_index"], one["dataset_to_index"], one["length"]) for one in told]
    assert spans == [(0, 3, 3), (3, 5, 2), (5, 7, 2)]
    assert [one["trial"] for one in told] == [first.name, second.name, second.name]
    assert [one["trial_outcome"] for one in told] == ["completed", "lost", "lost"]
    rows = rows_of(tmp_path / "set", 1)
    assert rows["trial.tick"] == [0, 1, 4, 5]
    assert rows["index"] == [3, 4, 5, 6]
    assert rows["frame_index"] == [0, 1, 0, 1]
    assert rows["timestamp"] == pytest.approx([0.0, 0.05, 0.0, 0.05])
    assert rows["action"] == [pytest.approx([0.8, 0.0, 0.0, -0.5])] * 4
    assert rows["command"] == [pytest.approx([1.0, 0.0, 0.0, -0.5])] * 4
    assert rows["observation.state"] == [pytest.approx([0.7, 0.0, 0.0, 0.0])] * 4
    assert rows["observation.target"] == [pytest.approx([0.5, 0.5, 0.2, 0.4, 1.0])] * 4
    assert rows["next.done"] == [False, False, False, True]
    video = f"videos/{CAMERA}"
    assert [(one[f"{video}/file_index"], one[f"{video}/from_timestamp"]) for one in told] == [
        (0, 0.0),
        (1, 0.0),
        (1, 0.1),
    ]


def test_a_trial_that_is_named_several_times_is_written_once(tmp_path):
    log = a_trial(tmp_path / "trials", [a_step(number) for number in range(4)])
    info = exported(log, tmp_path / "trials", log / "trial.mcap", out=tmp_path / "set")
    assert (info["total_episodes"], info["total_frames"]) == (1, 3)


def test_pictures_are_the_logs_and_masks_are_so_to_the_pixel(tmp_path):
    folder = a_trial(tmp_path, [a_step(number, frame_seq=40 * number) for number in range(5)])
    info = exported(folder, out=tmp_path / "set")
    frames = list(read_trial(folder).frames())[:4]
    film = film_of(tmp_path / "set")
    assert len(film) == 4
    for shown, frame in zip(film, frames, strict=True):
        assert np.abs(shown.astype(int) - frame.rgb).mean() < 3
    masks = rows_of(tmp_path / "set")[MASK]
    for picture, frame in zip(masks, frames, strict=True):
        assert np.array_equal(classes(picture["bytes"]), frame.mask)
    assert info["features"][CAMERA]["shape"] == list(film[0].shape)
    assert info["features"][MASK]["shape"] == [*frames[0].mask.shape, 3]


def test_a_log_without_pictures_has_its_masks(tmp_path):
    with a_log(tmp_path, frames="none") as log:
        for number in range(3):
            log.step(a_step(number, velocity=None), a_frame(number), an_observation(number))
        log.close({"outcome": "completed"})
    info = exported(log.folder, out=tmp_path / "set")
    assert CAMERA not in info["features"]
    assert "observation.state" not in info["features"]
    assert info["video_path"] is None
    assert len(rows_of(tmp_path / "set")[MASK]) == 2
    assert not (tmp_path / "set" / "videos").exists()


def test_the_task_is_what_was_said(tmp_path):
    folder = a_trial(tmp_path, [a_step(0), a_step(1)])
    exported(folder, out=tmp_path / "set", more=["--task", "Follow the red coat."])
    tasks = pq.read_table(tmp_path / "set/meta/tasks.parquet")
    assert tasks.to_pydict() == {"task_index": [0], "task": ["Follow the red coat."]}
    assert json.loads(tasks.schema.metadata[b"pandas"])["index_columns"] == ["task"]
    assert episodes_of(tmp_path / "set")[0]["tasks"] == ["Follow the red coat."]


def test_statistics_are_those_of_all_rows_and_of_each_episode(tmp_path):
    steps = [a_step(number, stale=number == 3) for number in range(7)]
    exported(a_trial(tmp_path, steps), out=tmp_path / "set")
    told = json.loads((tmp_path / "set/meta/stats.json").read_text())
    rows = rows_of(tmp_path / "set")
    assert told["trial.tick"]["mean"] == [np.mean(rows["trial.tick"])]
    assert told["trial.tick"]["count"] == [4]
    assert told["action"]["q50"] == pytest.approx([0.8, 0.0, 0.0, -0.5])
    assert np.shape(told[CAMERA]["std"]) == (3, 1, 1)
    assert [one["stats/trial.tick/max"] for one in episodes_of(tmp_path / "set")] == [[1.0], [5.0]]


def test_levels_counted_tell_what_the_pixels_tell():
    rng = np.random.default_rng(1)
    pictures = rng.integers(20, 240, (6, 32, 48, 3)).astype(np.uint8)
    one, other = PictureTally(), PictureTally()
    for place, picture in enumerate(pictures):
        (one if place < 2 else other).add(picture)
    one.merge(other)
    found = one.statistics()
    pixels = pictures[:, ::4, ::4].reshape(-1, 3) / 255
    assert found["count"] == [6]
    for name, wanted in of_numbers(pixels).items():
        if name != "count":
            assert np.ravel(found[name]) == pytest.approx(wanted, abs=1 / 255), name


def refused(capsys, *words):
    assert main(["export", *map(str, words)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_trials_that_differ_in_what_a_data_set_has_once_are_refused(tmp_path, capsys):
    small = a_trial(tmp_path / "a", [a_step(0), a_step(1)])
    with a_log(tmp_path / "b") as log:
        for number in range(2):
            log.step(a_step(number), a_frame(number, 80, 60), an_observation(number, 80, 60))
        log.close({"outcome": "completed"})
    told = refused(capsys, small, log.folder, "--lerobot", tmp_path / "set")
    assert "height and width are (60, 80), and (120, 160)" in told
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


def test_a_request_that_cannot_be_is_refused_in_a_line(tmp_path, capsys):
    folder = a_trial(tmp_path, [a_step(0)])
    assert "nothing to write" in refused(capsys, folder, "--lerobot", tmp_path / "set")
    (tmp_path / "there").mkdir()
    assert "is there already" in refused(capsys, folder, "--lerobot", tmp_path / "there")
    assert "takes one trial, got 2" in refused(capsys, folder, folder)
    assert "goes with --lerobot" in refused(capsys, folder, "--task", "x")
    assert not list(tmp_path.glob(".*"))


def test_without_pyarrow_it_says_what_to_install(tmp_path, capsys, monkeypatch):
    folder = a_trial(tmp_path, [a_step(0), a_step(1)])
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    told = refused(capsys, folder, "--lerobot", tmp_path / "set")
    assert "pip install 'adatracker-deploy[lerobot]'" in told
