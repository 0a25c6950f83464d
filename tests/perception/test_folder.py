"""A folder of pictures as a camera: all of them, in their natural order, at the rate that was asked for."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from streams import jpeg, picture

from adatracker_deploy.core.camera import FilmOverError
from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.perception import folder
from adatracker_deploy.perception.folder import FolderCamera, natural, pictures_in

START_NS = 7_000_000_000
PERIOD_NS = 100_000_000


def grey(value, size=(48, 64)):
    return np.full((*size, 3), value, np.uint8)


def png(rgb):
    return cv2.imencode(".png", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))[1].tobytes()


@pytest.fixture
def played(tmp_path):
    """Write a folder of named files and open it as a camera."""

    def play(files, **how):
        for name, data in files.items():
            (tmp_path / name).write_bytes(data)
        camera = FolderCamera(tmp_path, **how)
        camera.open()
        return camera

    return play


def numbered(count):
    return {f"frame{number}.png": png(grey(10 * number)) for number in range(1, count + 1)}


def test_pictures_come_in_the_natural_order_of_their_names_and_nothing_is_skipped(played):
    camera = played(numbered(12), every_frame=True)
    for number in range(1, 13):
        frame = camera.read(START_NS + number)
        assert (frame.seq, int(frame.rgb[0, 0, 0]), frame.t_ns) == (number, 10 * number, START_NS + number)
    with pytest.raises(FilmOverError, match="ended after 12 frames"):
        camera.read(START_NS + 13)


def test_they_play_at_ten_a_second_and_what_nobody_was_in_time_for_is_skipped(played):
    camera = played(numbered(12))
    camera.read(START_NS)
    for number in (1, 2, 10):
        frame = camera.read(START_NS + (number - 1) * PERIOD_NS + 3)
        assert (int(frame.rgb[0, 0, 0]), frame.t_ns) == (10 * number, START_NS + (number - 1) * PERIOD_NS)


def test_another_rate_may_be_asked_for(played):
    camera = played(numbered(12), rate_hz=5.0)
    camera.read(START_NS)
    assert camera.read(START_NS + 4 * PERIOD_NS).seq == 3


def test_png_and_jpeg_may_be_mixed_and_red_stays_red(played):
    red = grey(0)
    red[..., 0] = 250
    camera = played({"1.PNG": png(red), "2.JPeG": jpeg(red), "3.jpg": jpeg(red)}, every_frame=True)
    for _ in range(3):
        assert np.abs(camera.read(START_NS).rgb.astype(int) - red).max() < 12


def test_other_files_hidden_ones_and_folders_are_left_out(tmp_path):
    for name in ("b2.jpg", "b10.jpg", "._b1.jpg", "truth.txt", "b"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "more.png").mkdir()
    assert [path.name for path in pictures_in(tmp_path)] == ["b2.jpg", "b10.jpg"]


@given(st.lists(st.text(st.sampled_from("aB0192._-"), min_size=1, max_size=8), unique=True))
def test_any_names_have_one_order(names):
    turned = names[::-1]
    assert sorted(names, key=natural) == sorted(turned, key=natural)


@given(st.integers(0, 10**9), st.integers(0, 10**9))
def test_numbers_in_names_count_as_numbers(one, other):
    assert (natural(f"cam0_{one}.png") < natural(f"cam0_{other}.png")) == (one < other)


# Refusals


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"", "not a JPEG"),
        (b"no picture", "not a JPEG"),
        (png(grey(1))[:-20], "not a whole PNG"),
        (jpeg(picture())[:-20], "not a whole JPEG"),
    ],
)
def test_a_broken_first_picture_is_named_before_anything_starts(played, data, sentence, capfd):
    with pytest.raises(UsageError, match=rf"0\.png: {sentence}"):
        played({"0.png": data} | numbered(2))
    assert capfd.readouterr() == ("", "")


def test_a_broken_picture_later_on_ends_the_camera(played):
    camera = played(numbered(2) | {"frame3.png": b"torn"}, every_frame=True)
    camera.read(START_NS)
    camera.read(START_NS)
    with pytest.raises(PlatformError, match=r"frame 3: frame3\.png: not a JPEG"):
        camera.read(START_NS)


def test_a_size_that_changes_ends_the_camera(played):
    camera = played(numbered(1) | {"frame2.png": png(grey(1, (50, 64)))}, every_frame=True)
    camera.read(START_NS)
    with pytest.raises(PlatformError, match="size changed from 64x48 to 64x50"):
        camera.read(START_NS)


def test_a_header_that_claims_gigabytes_of_pixels_is_refused_before_they_are_made(played):
    header = b"IHDR" + struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
    data = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))
    with pytest.raises(UsageError, match=r"0\.png: pictures of 60000x60000 px"):
        played({"0.png": data + bytes(100)})


def test_a_file_too_large_for_any_picture_is_not_even_read(played, monkeypatch):
    monkeypatch.setattr(folder, "LARGEST_FILE_BYTES", 100)
    with pytest.raises(UsageError, match=r"0\.png: more than"):
        played({"0.png": png(picture())})


def test_pictures_that_vanish_are_named(played, tmp_path):
    camera = played(numbered(3), every_frame=True)
    camera.read(START_NS)
    (tmp_path / "frame2.png").unlink()
    with pytest.raises(PlatformError, match=r"frame2\.png: cannot be read \(No such file"):
        camera.read(START_NS)
