"""A written film can be read again, picture by picture, each at its time."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.perception.capture import Capture
from adatracker_deploy.perception.film_writer import FilmWriter, check_film_path

SECOND_NS = 1_000_000_000


def grey(value, size=(48, 64)):
    return np.full((*size, 3), value, np.uint8)


def levels(path):
    """Return how bright each frame of a film is, in steps of 20, and its rate."""
    film, found = Capture(str(path)), []
    while film.grab():
        found.append(round(float(film.rgb().mean()) / 20))
    rate_hz = film.rate_hz
    film.close()
    return found, rate_hz


def test_frames_at_the_films_own_rate_are_written_once_each(tmp_path):
    path = tmp_path / "out.mp4"
    writer = FilmWriter(path, 29.97)
    for number in range(12):
        writer.write(grey(20 * number), 5 * SECOND_NS + round(number * 1e9 / 29.97))
    writer.close()
    writer.close()
    found, rate_hz = levels(path)
    assert found == list(range(12))
    assert rate_hz == pytest.approx(29.97, abs=0.01)


def test_a_late_frame_leaves_the_one_before_it_standing_and_an_early_one_is_left_out(tmp_path):
    path = tmp_path / "out.mp4"
    writer = FilmWriter(path, 10.0)
    for number, at_s in ((0, 0.0), (1, 0.1), (5, 0.5), (6, 0.51), (7, 0.6)):
        writer.write(grey(20 * number), round(at_s * SECOND_NS))
    writer.close()
    assert levels(path)[0] == [0, 1, 1, 1, 1, 5, 7]


def test_red_stays_red(tmp_path):
    path = tmp_path / "out.mp4"
    writer = FilmWriter(path, 10.0)
    red = grey(0)
    red[:] = (220, 20, 30)
    writer.write(red, 0)
    writer.close()
    film = Capture(str(path))
    film.grab()
    assert np.abs(film.rgb().astype(int) - red).max() < 20


def test_another_size_is_refused(tmp_path):
    writer = FilmWriter(tmp_path / "out.mp4", 10.0)
    writer.write(grey(1), 0)
    with pytest.raises(PlatformError, match="another size"):
        writer.write(grey(1, (50, 64)), SECOND_NS)
    writer.close()


def test_a_film_without_frames_leaves_nothing(tmp_path):
    writer = FilmWriter(tmp_path / "out.mp4", 10.0)
    writer.close()
    assert not list(tmp_path.iterdir())


def test_a_writer_that_cannot_open_says_so(tmp_path, capfd):
    writer = FilmWriter(tmp_path / "gone" / "out.mp4", 10.0)
    with pytest.raises(UsageError, match=r"out\.mp4: OpenCV cannot write an MP4"):
        writer.write(grey(1), 0)
    assert capfd.readouterr() == ("", "")


def test_a_film_that_was_not_really_written_is_told_at_the_end(tmp_path):
    path = tmp_path / "out.mp4"
    writer = FilmWriter(path, 10.0)
    writer.write(grey(1), 0)
    path.unlink()
    with pytest.raises(PlatformError, match="cannot be read"):
        writer.close()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("out.avi", "ends in .mp4"),
        ("out", "ends in .mp4"),
        ("no/out.mp4", "no folder"),
        ("d.mp4", "cannot be"),
    ],
)
def test_what_cannot_be_written_is_refused_before_anything_starts(tmp_path, name, words):
    (tmp_path / "d.mp4").mkdir()
    with pytest.raises(UsageError, match=words):
        check_film_path(tmp_path / name)
    check_film_path(tmp_path / "OUT.MP4")
    assert not (tmp_path / "OUT.MP4").exists()


def test_a_film_is_of_a_codec_and_profile_that_browsers_play(tmp_path):
    """VP9, profile 0: 8 bits, 4:2:0 (the box `vpcC` of the VP Codec ISO Media File Format Binding, v1.0)."""
    path = tmp_path / "out.mp4"
    writer = FilmWriter(path, 10.0)
    for number in range(5):
        writer.write(grey(40 * number), number * SECOND_NS // 10)
    writer.close()
    data = path.read_bytes()
    assert data[4:8] == b"ftyp"
    assert b"mp4v" not in data
    assert b"vp09" in data
    version, profile, _, depth_and_chroma = struct.unpack_from(">B3xBBB", data, data.index(b"vpcC") + 4)
    assert (version, profile) == (1, 0)
    assert (depth_and_chroma >> 4, (depth_and_chroma >> 1) & 7 <= 1) == (8, True)
    assert levels(path)[0] == [0, 2, 4, 6, 8]


def test_a_film_that_is_interrupted_before_its_first_picture_leaves_nothing(tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    writer = FilmWriter(tmp_path / "out.mp4", 10.0)
    monkeypatch.setattr(FilmWriter, "_put", interrupted)
    with pytest.raises(KeyboardInterrupt):
        writer.write(grey(1), 0)
    writer.close()
    assert not list(tmp_path.iterdir())
