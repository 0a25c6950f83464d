"""A camera's URI means one thing, or is refused in a sentence before anything starts."""

from __future__ import annotations

import contextlib
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st
from streams import film, jpeg, picture

from adatracker_deploy.core.camera import without_password
from adatracker_deploy.core.clock import FakeClock
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.folder import FolderCamera
from adatracker_deploy.perception.mjpeg import MjpegCamera
from adatracker_deploy.perception.sources import KNOWN, FileCamera, check_uri, open_source
from adatracker_deploy.perception.video import VideoCamera
from adatracker_deploy.perception.zenoh_camera import CompressedImageCamera


@pytest.mark.parametrize(
    ("uri", "kind"),
    [
        ("http://10.0.0.7:8080/stream?topic=/camera", MjpegCamera),
        ("https://guard:secret@camera.local/video", MjpegCamera),
        ("http://[::1]/", MjpegCamera),
        ("rtsp://guard:secret@10.0.0.7/h264", VideoCamera),
        ("rtsps://10.0.0.7:322/h264", VideoCamera),
        ("udp://0.0.0.0:5600", VideoCamera),
        ("tcp://127.0.0.1:5000", VideoCamera),
        ("zenoh://10.0.0.7:7447/camera/image_raw/compressed", CompressedImageCamera),
        ("zenoh://[::1]:7447/0/image/sensor_msgs::msg::dds_::CompressedImage_/*", CompressedImageCamera),
        ("/dev/null", VideoCamera),
    ],
)
def test_each_address_means_its_kind_of_camera(uri, kind):
    assert type(open_source(uri, FakeClock())) is kind


def test_a_path_means_a_video_file(tmp_path):
    path = film(tmp_path / "clip.avi", [picture()] * 3)
    camera = open_source(str(path), FakeClock())
    assert type(camera) is FileCamera
    camera.open()
    assert camera.read(1).rgb.shape == (48, 64, 3)
    camera.close()


@pytest.mark.parametrize("uri", ["world://simple_room", "robot://camera/image"])
def test_what_belongs_to_a_run_is_right_but_cannot_be_opened_alone(uri):
    check_uri(uri)
    with pytest.raises(UsageError, match="only in a run with its robot"):
        open_source(uri, FakeClock())


@pytest.mark.parametrize(
    ("uri", "sentence"),
    [
        ("", "expected a device"),
        ("robot://", "expected world://SCENE or robot://TOPIC"),
        ("world://", "expected world://SCENE or robot://TOPIC"),
        (
            "ftp://10.0.0.7/clip.avi",
            "unknown scheme ftp://; expected a device .*rtsp.*udp.*gst:.*robot://TOPIC",
        ),
        ("RTSP://h/cam", "unknown scheme RTSP://"),
        ("http://", "names no host"),
        ("rtsp:///cam", "names no host"),
        ("http://h:65536/", "out of range"),
        ("http://h:0/", "0 is not a port"),
        ("rtsp://h:port/", "port"),
        ("rtsp://[::1/", "IPv6"),
        ("udp://10.0.0.7", "names no port; expected udp://HOST:PORT"),
        ("zenoh://10.0.0.7/image", "names no port; expected zenoh://HOST:PORT"),
        ("zenoh://10.0.0.7:7447", "expected zenoh://HOST:PORT/TOPIC"),
        ("zenoh://10.0.0.7:7447//image", "expected zenoh://HOST:PORT/TOPIC"),
        ("zenoh://10.0.0.7:7447/image?rate=5", "expected zenoh://HOST:PORT/TOPIC"),
        ("zenoh://guard:zzz@10.0.0.7:7447/image", "expected zenoh://HOST:PORT/TOPIC"),
        ("http://h/a b", "no spaces or special characters"),
        ("http://h/a\r\nX-Evil: 1", "no spaces or special characters"),
        ("no-such-file.mp4", "no such file"),
        ("987", "there is no device /dev/video987; cameras here: "),
        ("/dev/video987", "there is no device /dev/video987"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(uri, sentence):
    for refuse in (check_uri, lambda uri: open_source(uri, FakeClock())):
        with pytest.raises(UsageError, match=f"^camera .*{sentence}") as raised:
            refuse(uri)
        assert "\n" not in str(raised.value)


def test_without_its_library_a_zenoh_camera_is_refused_with_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "zenoh", None)
    with pytest.raises(UsageError, match=r"pip install 'adatracker-deploy\[zenoh\]'"):
        check_uri("zenoh://10.0.0.7:7447/image")


def test_nothing_of_zenoh_is_imported_before_it_is_asked_for():
    code = (
        "import sys, adatracker_deploy.cli.view, adatracker_deploy.app.view_run\n"
        "from adatracker_deploy.perception import sources\n"
        "sources.check_uri('zenoh://10.0.0.7:7447/image')\n"
        "assert 'zenoh' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_folder_means_its_pictures_at_the_rate_after_it(tmp_path):
    (tmp_path / "1.jpg").write_bytes(jpeg(picture()))
    for query, rate_hz in (("", 10.0), ("?rate=4", 4.0), ("?rate=29.97", 29.97)):
        camera = open_source(f"{tmp_path}{query}", FakeClock())
        assert type(camera) is FolderCamera
        camera.open()
        assert camera.rate_hz == rate_hz


def test_a_folder_may_be_called_what_looks_like_a_rate(tmp_path):
    folder = tmp_path / "walk?rate=5"
    folder.mkdir()
    (folder / "1.jpg").write_bytes(jpeg(picture()))
    camera = open_source(str(folder), FakeClock())
    camera.open()
    assert camera.rate_hz == 10.0


@pytest.mark.parametrize("rate", ["0", "-3", "nan", "inf", "241", "ten", ""])
def test_a_rate_that_cannot_be_is_refused(tmp_path, rate):
    (tmp_path / "1.jpg").write_bytes(jpeg(picture()))
    with pytest.raises(UsageError, match=r"expected \?rate=HZ of 1 to 240"):
        check_uri(f"{tmp_path}?rate={rate}")


def test_a_rate_is_not_for_files(tmp_path):
    path = film(tmp_path / "clip.avi", [picture()] * 3)
    with pytest.raises(UsageError, match="a video file has a rate of its own"):
        check_uri(f"{path}?rate=5")


@pytest.mark.parametrize("names", [[], ["notes.txt", ".hidden.png"]])
def test_a_folder_without_pictures_is_refused(tmp_path, names):
    for name in names:
        (tmp_path / name).write_bytes(jpeg(picture()))
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(UsageError, match="a folder without PNG or JPEG pictures"):
        check_uri(str(tmp_path))


def test_a_pipeline_is_refused_where_opencv_has_no_gstreamer_and_where_it_has_no_end():
    with pytest.raises(UsageError, match=r"lacks GStreamer.*install one that has|must end in"):
        check_uri("gst:videotestsrc")


def test_a_refusal_lists_what_there_is():
    with pytest.raises(UsageError) as raised:
        check_uri("smb://nas/clip.avi")
    assert KNOWN in str(raised.value)


@given(
    st.text(max_size=40), st.sampled_from(["", "http://", "rtsp://", "tcp://", "gst:", "/dev/", "world://"])
)
def test_any_text_is_taken_or_refused_and_nothing_else(text, beginning):
    with contextlib.suppress(UsageError):
        check_uri(beginning + text)


@given(st.sampled_from(["http", "rtsp"]), st.from_regex(r"[a-z]{1,8}(:[a-z@:]{1,8})?", fullmatch=True))
def test_a_password_is_never_shown(scheme, user):
    assert without_password(f"{scheme}://{user}@h:80/a@b?c=d@e") == f"{scheme}://h:80/a@b?c=d@e"
    with pytest.raises(UsageError) as raised:
        check_uri(f"{scheme}://{user}zzz@h:0/")
    assert "zzz" not in str(raised.value)
