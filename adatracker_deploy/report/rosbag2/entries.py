"""Contents of a trial's bag: each message of its log as messages of ROS 2, at the same time."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.message import DecodeError

from adatracker_deploy.config.schema import parse
from adatracker_deploy.core.camera_info import CameraInfo
from adatracker_deploy.report.rosbag2 import messages as ros

if TYPE_CHECKING:
    from collections.abc import Iterator

    from adatracker_deploy.core.record import StepRecord
    from adatracker_deploy.trial.reader import LoggedMessage, Trial

_TOPICS = ("/camera", "/mask", "/box", "/step", "/log")


class Entry(NamedTuple):
    """A message of the bag, with its topic below ``/adatracker``."""

    topic: str
    type_name: str
    message: Any


def entries(trial: Trial) -> Iterator[tuple[int, Entry]]:
    """Give what the bag holds, with its time in the log, ns, in the log's order.

    A damaged message is left out.

    Raises:
        UsageError: the log cannot be read any more, or its camera_info is none.
    """
    steps = {step.step: step for step in trial.steps}
    lens = _Lens(trial)
    for message in trial.messages(_TOPICS):
        with contextlib.suppress(DecodeError):
            for entry in _entries(message, steps.get(message.sequence), lens, trial.platform):
                yield message.wall_ns, entry


def _entries(message: LoggedMessage, step: StepRecord | None, lens: _Lens, platform: str) -> Iterator[Entry]:
    match message.topic:
        case "/camera" | "/mask":
            yield from _picture(message, lens)
        case "/box" if step is not None:
            yield _box(message, step)
        case "/step" if step is not None:
            yield from _tick(message.wall_ns, step, platform)
        case "/log":
            line = Log.FromString(message.data)
            level = Log.Level.Name(line.level).lower()
            yield Entry("log", ros.LOG, ros.log_line(level, line.message, message.wall_ns))


def _picture(message: LoggedMessage, lens: _Lens) -> Iterator[Entry]:
    logged = CompressedImage.FromString(message.data)
    captured_ns = logged.timestamp.ToNanoseconds()
    what = message.topic.removeprefix("/")
    yield Entry(f"{what}/compressed", ros.IMAGE, ros.image(logged.data, logged.format, captured_ns))
    if what == "camera" and (found := lens.of(logged.data)) is not None:
        yield Entry("camera_info", ros.CAMERA_INFO, ros.camera_info(found, captured_ns))


def _box(message: LoggedMessage, step: StepRecord) -> Entry:
    outlines = ImageAnnotations.FromString(message.data).points
    corners_px = [(point.x, point.y) for outline in outlines for point in outline.points]
    captured_ns = message.wall_ns - (step.t_ns - step.frame_t_ns)
    return Entry("box", ros.MARKER, ros.marker(corners_px, captured_ns))


def _tick(now_ns: int, step: StepRecord, platform: str) -> Iterator[Entry]:
    age_s = step.state_age_s if math.isfinite(step.state_age_s) else 0.0
    measured_ns = now_ns - round(age_s * 1e9)
    yield Entry("command/asked", ros.TWIST, ros.twist(step.command, now_ns))
    if step.sent is not None:
        yield Entry("command/sent", ros.TWIST, ros.twist(step.sent, now_ns))
    if step.velocity is not None:
        yield Entry("velocity", ros.TWIST, ros.twist(step.velocity, measured_ns))
    if step.pose is not None:
        yield Entry("odom", ros.ODOMETRY, ros.odometry(step.pose, step.velocity, measured_ns))
    if step.battery is not None:
        yield Entry("battery", ros.BATTERY, ros.battery(step.battery, measured_ns))
    yield Entry("diagnostics", ros.DIAGNOSTICS, ros.diagnostics(step, platform, now_ns))


class _Lens:
    """The camera's lens by a trial's configuration: as its profile has it, else as the camera told it."""

    def __init__(self, trial: Trial) -> None:
        config = trial.config if isinstance(trial.config, Mapping) else {}
        told, profile = config.get("camera_info"), config.get("profile")
        self._found = parse(CameraInfo, told, where=f"{trial.path}: camera_info") if told else None
        camera = profile.get("camera") if isinstance(profile, Mapping) else None
        self._fov_deg = camera.get("fov_deg") if isinstance(camera, Mapping) else None

    def of(self, jpeg: bytes) -> CameraInfo | None:
        """Return the lens of a picture; None where nobody knows it."""
        if self._fov_deg is not None:
            picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
            if picture is None:
                return None
            height, width = picture.shape
            self._found = CameraInfo.pinhole(math.radians(self._fov_deg), width, height)
            self._fov_deg = None
        return self._found
