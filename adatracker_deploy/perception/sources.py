"""Opens a camera by its URI."""

from __future__ import annotations

import re
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import SplitResult, urlsplit

from adatracker_deploy.core.camera import ROBOT, WORLD, without_password
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.capture import Capture, has_gstreamer
from adatracker_deploy.perception.film import FASTEST_HZ, SLOWEST_HZ, FilmCamera
from adatracker_deploy.perception.folder import USUAL_HZ, FolderCamera, pictures_in
from adatracker_deploy.perception.mjpeg import MjpegCamera
from adatracker_deploy.perception.video import DEVICE, GSTREAMER, VideoCamera

if TYPE_CHECKING:
    from pathlib import Path

    from adatracker_deploy.core.camera import Camera
    from adatracker_deploy.core.clock import Clock


class FileCamera(FilmCamera):
    """Plays a video file; `every_frame` as in `FilmCamera`."""

    def __init__(self, path: Path, *, every_frame: bool = False) -> None:
        super().__init__(str(path), every_frame=every_frame)
        self._path = path

    def _open_film(self) -> Capture:
        return Capture(str(self._path))


ZENOH = "zenoh://"
KNOWN = (
    f"a device (0, /dev/video0), a video file, a folder of PNG or JPEG pictures ({USUAL_HZ:g} Hz, or "
    "FOLDER?rate=HZ), http(s)://HOST/PATH (MJPEG), rtsp(s)://HOST/PATH, "
    f"udp://HOST:PORT, tcp://HOST:PORT, {ZENOH}HOST:PORT/TOPIC, {GSTREAMER}PIPELINE, "
    f"{WORLD}SCENE or {ROBOT}TOPIC"
)
"""The supported forms of a camera URI."""

_MJPEG_SCHEMES = ("http", "https")
_ZENOH_SCHEME = "zenoh"
_STREAM_SCHEMES = ("rtsp", "rtsps", "udp", "tcp")
_PORT_NEEDED = ("udp", "tcp", _ZENOH_SCHEME)
_KEY_EXPRESSION = re.compile(r"(?:\*{1,2}|[^/*$?#\s]+)(?:/(?:\*{1,2}|[^/*$?#\s]+))*")
"""Zenoh's, and so any topic of ROS 2 as zenoh-bridge-ros2dds passes it on."""
_RATE = "?rate="
_SCHEME = re.compile(r"([a-zA-Z][a-zA-Z0-9+.-]*)://")


def check_uri(uri: str) -> None:
    """Check a camera URI before anything starts; opens nothing.

    Raises:
        UsageError: it cannot.
    """
    if uri.startswith((ROBOT, WORLD)):
        if uri in (ROBOT, WORLD):
            raise UsageError(f"camera {uri!r}: expected {WORLD}SCENE or {ROBOT}TOPIC")
    elif uri.startswith(GSTREAMER):
        _check_pipeline(uri)
    elif scheme := _SCHEME.match(uri):
        _check_address(uri, scheme[1])
    else:
        _check_path(uri)


def open_source(uri: str, clock: Clock, *, every_frame: bool = False) -> Camera:
    """Return the camera for `uri`, not open yet.

    Args:
        uri: see `KNOWN`.
        clock: the run's.
        every_frame: of a file or folder; see `FilmCamera`.

    Raises:
        UsageError: no camera has such a URI.
    """
    check_uri(uri)
    if uri.startswith((ROBOT, WORLD)):
        raise UsageError(f"camera {uri!r}: it exists only in a run with its robot; expected {KNOWN}")
    scheme = _SCHEME.match(uri)
    if scheme is not None and scheme[1] in _MJPEG_SCHEMES:
        return MjpegCamera(uri, clock)
    if scheme is not None and scheme[1] == _ZENOH_SCHEME:
        return _zenoh_camera(uri, clock)
    if scheme is not None or uri.startswith((GSTREAMER, DEVICE)):
        return VideoCamera(uri, clock)
    if uri.isdecimal():
        return VideoCamera(_device(uri), clock)
    path, rate_hz = _path_and_rate(uri)
    if path.is_dir():
        return FolderCamera(path, rate_hz=rate_hz or USUAL_HZ, every_frame=every_frame)
    return FileCamera(path, every_frame=every_frame)


def _check_pipeline(uri: str) -> None:
    shown = without_password(uri)
    if not has_gstreamer():
        raise UsageError(
            f"camera {shown!r}: this build of OpenCV lacks GStreamer, like the one on PyPI: install one "
            "that has it (a Jetson's own, Debian's python3-opencv), or let the pipeline serve RTSP or MJPEG"
        )
    if "appsink" not in uri:
        raise UsageError(f"camera {shown!r}: the pipeline must end in '! videoconvert ! appsink'")


def _check_address(uri: str, scheme: str) -> None:
    shown = without_password(uri)
    if scheme not in (*_MJPEG_SCHEMES, *_STREAM_SCHEMES, _ZENOH_SCHEME):
        raise UsageError(f"camera {shown!r}: unknown scheme {scheme}://; expected {KNOWN}")
    if not uri.isascii() or not uri.isprintable() or " " in uri:
        raise UsageError(
            f"camera {shown!r}: an address has no spaces or special characters; write them as %XX"
        )
    url = _split(uri, shown)
    if not url.hostname:
        raise UsageError(f"camera {shown!r}: names no host; expected {scheme}://HOST:PORT/PATH")
    if scheme in _PORT_NEEDED and url.port is None:
        raise UsageError(f"camera {shown!r}: names no port; expected {scheme}://HOST:PORT")
    if scheme == _ZENOH_SCHEME:
        _check_zenoh(shown, url)


def _check_zenoh(shown: str, url: SplitResult) -> None:
    if url.username or url.query or url.fragment or not _KEY_EXPRESSION.fullmatch(url.path[1:]):
        raise UsageError(
            f"camera {shown!r}: expected {ZENOH}HOST:PORT/TOPIC, a topic of sensor_msgs/CompressedImage such "
            "as camera/image_raw/compressed"
        )
    if find_spec("zenoh") is None:
        raise UsageError(f"camera {shown!r}: needs eclipse-zenoh: pip install 'adatracker-deploy[zenoh]'")


def _zenoh_camera(uri: str, clock: Clock) -> Camera:
    from adatracker_deploy.perception.zenoh_camera import CompressedImageCamera

    url = urlsplit(uri)
    return CompressedImageCamera(uri, clock, endpoint=f"tcp/{url.netloc}", key=url.path[1:])


def _split(uri: str, shown: str) -> SplitResult:
    try:
        url = urlsplit(uri)
        if url.port == 0:
            raise ValueError("0 is not a port (1 to 65535)")
    except ValueError as error:
        raise UsageError(f"camera {shown!r}: {error}") from error
    return url


def _device(number: str) -> str:
    return f"{DEVICE}video{int(number)}"


def _check_path(uri: str) -> None:
    if not uri:
        raise UsageError(f"camera '': expected {KNOWN}")
    path, rate_hz = (Path(_device(uri)), None) if uri.isdecimal() else _path_and_rate(uri)
    if path.is_relative_to(DEVICE):
        if not path.is_char_device():
            found = ", ".join(sorted(map(str, Path(DEVICE).glob("video*")))) or "none"
            raise UsageError(f"camera {uri!r}: there is no device {path}; cameras here: {found}")
    elif not path.exists():
        raise UsageError(f"camera {uri!r}: no such file; expected {KNOWN}")
    elif path.is_dir():
        try:
            pictures_in(path)
        except ValueError as error:
            raise UsageError(f"camera {uri!r}: {error}") from error
    elif not path.is_file():
        raise UsageError(f"camera {uri!r}: is not a video file")
    elif rate_hz is not None:
        raise UsageError(f"camera {uri!r}: a video file has a rate of its own; {_RATE}HZ is for folders")


def _path_and_rate(uri: str) -> tuple[Path, float | None]:
    """Return the path and, where the URI names one, the rate, Hz."""
    text, named, rate = uri.rpartition(_RATE)
    if not named or Path(uri).exists():  # any name may be a file's
        return Path(uri), None
    try:
        rate_hz = float(rate)
    except ValueError:
        rate_hz = 0.0
    if not SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
        raise UsageError(f"camera {uri!r}: expected {_RATE}HZ of {SLOWEST_HZ:g} to {FASTEST_HZ:g}")
    return Path(text), rate_hz
