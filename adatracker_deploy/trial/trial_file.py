"""What a trial's MCAP file holds: its channels, their schemas, and how a tick is encoded.

| topic    | schema                    | content                                                       |
|----------|---------------------------|---------------------------------------------------------------|
| /step    | adatracker.Step, JSON     | every field of `StepRecord`                                   |
| /command | adatracker.Command, JSON  | the twist asked for and the twist really sent                 |
| /camera  | foxglove.CompressedImage  | the frame, JPEG; a frame that several ticks saw is there once |
| /mask    | foxglove.CompressedImage  | the class mask, palette PNG whose pixel values are the ids    |
| /box     | foxglove.ImageAnnotations | the target's box in the frame's pixels; empty while lost      |
| /pose    | foxglove.PoseInFrame      | where the robot's telemetry says it is                        |
| /log     | foxglove.Log              | events                                                        |

Foxglove's schemas come as protobuf, from its own package, because images in JSON would be a third larger.
Messages carry wall-clock time; the camera's and mask's sequence number is the frame's.
The metadata records `trial`, `config` and, when the trial ended in order, `summary` hold the rest.

What a policy was shown and answered is there to the bit, so that `replay` can ask it again: masks are palette
PNGs without loss; box, `action` and `context` (z) are float32 or float64 written as the shortest text that
reads back the same; the frame's time is `t_ns` less `latency.observation_age_ms`; a tick with an empty
`action` was too old to act on, and the policy was not asked; `config` has the seed of its reset and the
SHA-256 of each file of its bundle; its last action is its own answer, not what the gate sent. The pictures
are JPEG: what perception saw is not there to the bit, and no policy sees it.
"""

from __future__ import annotations

import dataclasses
import json
import math
from typing import IO, TYPE_CHECKING, Any

import cv2
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointsAnnotation_pb2 import PointsAnnotation
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.writer import CompressionType, IndexType, Writer

from adatracker_deploy.trial.mask_png import encode_mask
from adatracker_deploy.trial.step_json import STEP_SCHEMA_NAME, step_schema, step_to_json

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from adatracker_deploy.geometry import Pose
    from adatracker_deploy.messages import Box, ClassMask
    from adatracker_deploy.trial.record import StepRecord

JPEG_QUALITY = 85
_LEVELS = {"info": Log.INFO, "warning": Log.WARNING, "error": Log.ERROR}
_TWIST_SCHEMA = {
    "type": "object",
    "properties": {axis: {"type": "number"} for axis in ("vx", "vy", "vz", "yaw_rate")},
}
_COMMAND_SCHEMA = {
    "title": "adatracker.Command",
    "description": "Body frame of REP 103: x forward, y left, z up, yaw counter-clockwise; m/s and rad/s.",
    "type": "object",
    "properties": {"asked": _TWIST_SCHEMA, "sent": _TWIST_SCHEMA},
}
_GREEN = {"r": 0.24, "g": 0.86, "b": 0.35, "a": 1.0}


class TrialFile:
    """Encodes a trial into an open stream; without compression and chunks, so that every record stands alone.

    Args:
        stream: anything with `write` and `tell`.
        metadata: records by name, each a mapping of texts.
    """

    def __init__(self, stream: IO[bytes], metadata: Mapping[str, Mapping[str, str]]) -> None:
        self._mcap = start_mcap(stream)
        for name, record in metadata.items():
            self._mcap.add_metadata(name, dict(record))
        self._channels = {
            "/step": self._json_channel("/step", STEP_SCHEMA_NAME, step_schema()),
            "/command": self._json_channel(
                "/command", "adatracker.Command", json.dumps(_COMMAND_SCHEMA).encode()
            ),
            "/camera": self._foxglove_channel("/camera", CompressedImage),
            "/mask": self._foxglove_channel("/mask", CompressedImage),
            "/box": self._foxglove_channel("/box", ImageAnnotations),
            "/pose": self._foxglove_channel("/pose", PoseInFrame),
            "/log": self._foxglove_channel("/log", Log),
        }
        self._frame_size: tuple[int, int] | None = None

    def picture(
        self, wall_ns: int, captured_ns: int, seq: int, rgb: NDArray[np.uint8], mask: ClassMask
    ) -> None:
        """Write a frame and its mask."""
        self._frame_size = (rgb.shape[1], rgb.shape[0])
        bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
        _, jpeg = cv2.imencode(".jpg", bgr, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))
        images = {"/camera": ("jpeg", jpeg.tobytes()), "/mask": ("png", encode_mask(mask))}
        for topic, (encoding, data) in images.items():
            image = CompressedImage(frame_id="camera", format=encoding, data=data)
            image.timestamp.FromNanoseconds(captured_ns)
            self._write(topic, wall_ns, image.SerializeToString(), seq)

    def step(self, wall_ns: int, captured_ns: int, record: StepRecord) -> None:
        """Write a tick."""
        self._write("/step", wall_ns, step_to_json(record), record.step)
        twists = {"asked": dataclasses.asdict(record.command), "sent": dataclasses.asdict(record.sent)}
        self._write("/command", wall_ns, json.dumps(twists).encode(), record.step)
        if self._frame_size is not None:
            box = _annotation(record.box, self._frame_size, captured_ns)
            self._write("/box", wall_ns, box.SerializeToString(), record.step)
        if record.pose is not None:
            pose = _pose(record.pose, wall_ns)
            self._write("/pose", wall_ns, pose.SerializeToString(), record.step)

    def event(self, wall_ns: int, level: str, message: str) -> None:
        """Write an event."""
        line = Log(level=_LEVELS[level], message=message, name="adatracker")
        line.timestamp.FromNanoseconds(wall_ns)
        self._write("/log", wall_ns, line.SerializeToString(), 0)

    def finish(self, summary_json: str | None) -> None:
        """Write the summary, if the trial has one, and the file's index."""
        if summary_json is not None:
            self._mcap.add_metadata("summary", {"json": summary_json})
        self._mcap.finish()

    def _json_channel(self, topic: str, name: str, schema: bytes) -> int:
        schema_id = self._mcap.register_schema(name, "jsonschema", schema)
        return int(self._mcap.register_channel(topic, "json", schema_id))

    def _foxglove_channel(self, topic: str, message: Any) -> int:
        descriptor = message.DESCRIPTOR
        schema_id = self._mcap.register_schema(descriptor.full_name, "protobuf", _descriptor_set(descriptor))
        return int(self._mcap.register_channel(topic, "protobuf", schema_id))

    def _write(self, topic: str, wall_ns: int, data: bytes, sequence: int) -> None:
        self._mcap.add_message(self._channels[topic], wall_ns, data, wall_ns, sequence)


def start_mcap(stream: IO[bytes]) -> Writer:
    """Begin an MCAP file whose records each stand alone."""
    mcap = Writer(
        stream, compression=CompressionType.NONE, use_chunking=False, index_types=IndexType.METADATA
    )
    mcap.start(library="adatracker-deploy")
    return mcap


def _descriptor_set(descriptor: Any) -> bytes:
    """Return a message's file and all it imports, as MCAP's protobuf schema encoding wants them."""
    files: dict[str, Any] = {}

    def add(file: Any) -> None:
        for dependency in file.dependencies:
            add(dependency)
        files.setdefault(file.name, file)

    add(descriptor.file)
    result = FileDescriptorSet()
    for file in files.values():
        file.CopyToProto(result.file.add())
    return bytes(result.SerializeToString())


def _annotation(box: Box | None, frame_size: tuple[int, int], captured_ns: int) -> ImageAnnotations:
    annotations = ImageAnnotations()
    if box is not None:
        width, height = frame_size
        left, right = (box.cx - box.w / 2) * width, (box.cx + box.w / 2) * width
        top, bottom = (box.cy - box.h / 2) * height, (box.cy + box.h / 2) * height
        outline = annotations.points.add(type=PointsAnnotation.LINE_LOOP, thickness=2.0, outline_color=_GREEN)
        outline.timestamp.FromNanoseconds(captured_ns)
        for x, y in ((left, top), (right, top), (right, bottom), (left, bottom)):
            outline.points.add(x=x, y=y)
    return annotations


def _pose(pose: Pose, wall_ns: int) -> PoseInFrame:
    message = PoseInFrame(frame_id="local")
    message.timestamp.FromNanoseconds(wall_ns)
    position, orientation = message.pose.position, message.pose.orientation
    position.x, position.y, position.z = pose.x, pose.y, pose.z
    # The quaternion of Rz(yaw) Ry(pitch) Rx(roll), from half angles.
    cr, sr = math.cos(pose.roll / 2), math.sin(pose.roll / 2)
    cp, sp = math.cos(pose.pitch / 2), math.sin(pose.pitch / 2)
    cy, sy = math.cos(pose.yaw / 2), math.sin(pose.yaw / 2)
    orientation.w = cr * cp * cy + sr * sp * sy
    orientation.x = sr * cp * cy - cr * sp * sy
    orientation.y = cr * sp * cy + sr * cp * sy
    orientation.z = cr * cp * sy - sr * sp * cy
    return message
