"""A video file as a camera: the same every time, at its own rate or frame by frame."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from streams import film, jpeg, opening, picture

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.perception.sources import FileCamera

START_NS = 7_000_000_000
PERIOD_NS = 40_000_000
FRAMES = 30


def grey(value):
    return np.full((48, 64, 3), value, np.uint8)


def number_in(frame):
    """Return which frame of the film the picture shows, from 1."""
    return round(float(frame.rgb.mean()) / 8) + 1


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return film(tmp_path_factory.mktemp("films") / "grey.avi", [grey(8 * i) for i in range(FRAMES)])


@pytest.fixture
def play(path):
    with opening(lambda path=path, **how: FileCamera(path, **how)) as play:
        yield play


def test_a_film_begins_with_the_first_look_and_goes_on_at_its_own_rate(play):
    camera = play()
    camera.read(START_NS)
    for number in (1, 2, 3, 10, 30):
        frame = camera.read(START_NS + (number - 1) * PERIOD_NS + 3)
        assert (frame.seq, number_in(frame)) == (number, number)
        assert frame.t_ns == START_NS + (number - 1) * PERIOD_NS


def test_until_the_next_frame_is_due_the_same_one_comes_again(play):
    camera = play()
    first = camera.read(START_NS)
    assert camera.read(START_NS + PERIOD_NS - 1) is first
    assert camera.read(START_NS - 5) is first
    assert camera.read(START_NS + PERIOD_NS) is not first


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=30, deadline=None)
@given(st.lists(st.integers(0, (FRAMES - 1) * PERIOD_NS), min_size=1, max_size=10).map(sorted))
def test_whenever_it_is_looked_at_the_frame_is_the_one_of_that_moment(play, moments):
    camera = play()
    camera.read(START_NS)
    for moment in moments:
        frame = camera.read(START_NS + moment)
        assert number_in(frame) == frame.seq == moment // PERIOD_NS + 1
        assert frame.t_ns <= START_NS + moment < frame.t_ns + PERIOD_NS


def test_frame_by_frame_nothing_is_skipped_and_nothing_is_old(play):
    camera = play(every_frame=True)
    for number in range(1, FRAMES + 1):
        frame = camera.read(START_NS + 7 * number)
        assert (frame.seq, number_in(frame), frame.t_ns) == (number, number, START_NS + 7 * number)


@pytest.mark.parametrize("every_frame", [False, True])
def test_the_end_is_said_and_stays_the_end(play, every_frame):
    camera = play(every_frame=every_frame)

    def to_the_end():
        for number in range(FRAMES + 1):
            camera.read(START_NS + number * PERIOD_NS)

    for look in (to_the_end, lambda: camera.read(START_NS + 2 * FRAMES * PERIOD_NS)):
        with pytest.raises(PlatformError, match=f"the video has ended after {FRAMES} frames"):
            look()


def test_red_stays_red(play, tmp_path):
    red = np.full((48, 64, 3), (220, 20, 30), np.uint8)
    frame = play(film(tmp_path / "red.avi", [red] * 3)).read(START_NS)
    assert np.abs(frame.rgb.astype(int) - red).max() < 12


def test_a_film_may_stand_still(play, tmp_path):
    camera = play(film(tmp_path / "still.avi", [grey(9)] * 100))
    assert camera.read(START_NS).seq == 1
    assert camera.read(START_NS + 99 * PERIOD_NS).seq == 100


def test_a_rate_that_cannot_be_is_taken_for_the_usual_one(play, tmp_path):
    camera = play(film(tmp_path / "quick.avi", [grey(i) for i in range(50)], rate_hz=1000.0))
    camera.read(START_NS)
    assert camera.read(START_NS + 10 * PERIOD_NS).seq == 11


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"no video at all " * 100,
        b"RIFF\xff\xff\xff\xffAVI LIST",
        b"\0\0\0\x10ftypmp42\0\0\0\0\0\0\0\x10mdat\0\0\0\0\0\0\0\0",
    ],
)
def test_what_is_no_video_is_refused_before_anything_starts(play, tmp_path, content, capfd):
    path = tmp_path / "clip.avi"
    path.write_bytes(content)
    with pytest.raises(UsageError, match=r"clip\.avi: cannot be opened as a video"):
        play(path)
    assert capfd.readouterr() == ("", "")


def test_a_film_that_breaks_off_ends_there(play, path, tmp_path):
    data = path.read_bytes()
    torn = tmp_path / "torn.avi"
    torn.write_bytes(data[: len(data) // 2])
    camera = play(torn, every_frame=True)

    def to_the_end():
        for number in range(FRAMES):
            assert number_in(camera.read(START_NS + number)) == number + 1

    with pytest.raises(PlatformError, match=r"has ended after [1-9][0-9]? frames"):
        to_the_end()


def test_before_it_is_open_there_is_nothing_to_see(path):
    camera = FileCamera(path)
    assert camera.read(START_NS) is None
    camera.close()
    camera.close()


def test_a_photograph_is_a_film_of_one_frame(play, tmp_path):
    path = tmp_path / "photo.jpg"
    path.write_bytes(jpeg(picture()))
    assert play(path).read(START_NS).rgb.shape == (48, 64, 3)
