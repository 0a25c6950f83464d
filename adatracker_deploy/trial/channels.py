"""Channels of a trial's log and live view, their schemas, and the encoding of a tick.

| topic    | schema                    | content                                                       |
|----------|---------------------------|---------------------------------------------------------------|
| /step    | adatracker.Step, JSON     | every field of `StepRecord`                                   |
| /command | adatracker.Command, JSON  | the twist asked for, and what the link then sent for it       |
| /camera  | foxglove.CompressedImage  | the frame, JPEG; a frame that several ticks saw is there once |
| /mask    | foxglove.CompressedImage  | the class mask, palette PNG whose pixel values are the ids    |
| /box     | foxglove.ImageAnnotations | the target's box in the frame's pixels; empty while lost      |
| /pose    | foxglove.PoseInFrame      | where the robot's telemetry says it is                        |
| /log     | foxglove.Log              | events                                                        |

Foxglove's schemas come as protobuf, from its own package, because images in JSON would be a third larger.
A camera's own JPEG is passed on as it came: making another takes most of what logging costs. Pictures are
blurred, or left out, where that was asked for. Messages carry wall-clock time; the camera's and mask's
sequence number is the frame's.
"""

from __future__ import annotations

import dataclasses
import json
from typing import TYPE_CHECKING, Any, NamedTuple

import cv2
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointsAnnotation_pb2 import PointsAnnotation
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from google.protobuf.descriptor_pb2 import FileDescriptorSet

from adatracker_deploy.core.geometry import Pose, Quaternion
from adatracker_deploy.core.mask_png import encode_mask
from adatracker_deploy.trial.privacy import Anonymiser
from adatracker_deploy.trial.step_json import STEP_SCHEMA_NAME, step_schema, step_to_json

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Box
    from adatracker_deploy.core.record import StepRecord
    from adatracker_deploy.trial.ipc import Picture
    from adatracker_deploy.trial.privacy import Frames

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
    "required": ["asked"],
}
_GREEN = {"r": 0.24, "g": 0.86, "b": 0.35, "a": 1.0}


class Channel(NamedTuple):
    """A topic and what its messages are; encodings by the names that MCAP and Foxglove's websocket share."""

    topic: str
    encoding: str
    schema_name: str
    schema_encoding: str
    schema: bytes


class Message(NamedTuple):
    """One message, encoded; wall-clock time, ns."""

    topic: str
    wall_ns: int
    data: bytes
    sequence: int


def channels() -> tuple[Channel, ...]:
    """Return the table above."""
    return (
        _json_channel("/step", STEP_SCHEMA_NAME, step_schema()),
        _json_channel("/command", "adatracker.Command", json.dumps(_COMMAND_SCHEMA).encode()),
        _foxglove_channel("/camera", CompressedImage),
        _foxglove_channel("/mask", CompressedImage),
        _foxglove_channel("/box", ImageAnnotations),
        _foxglove_channel("/pose", PoseInFrame),
        _foxglove_channel("/log", Log),
    )


class Encoder:
    """Turns ticks into messages, in the order in which they came.

    Args:
        frames: what is kept of the camera's pictures; those to be blurred must come as RGB.
    """

    def __init__(self, frames: Frames = "full") -> None:
        self._frames = frames
        self._veil = Anonymiser()
        self._frame_size: tuple[int, int] | None = None

    def picture(self, wall_ns: int, captured_ns: int, seq: int, picture: Picture) -> list[Message]:
        """Encode a frame and its mask.

        Raises:
            cv2.error: the frame is not a picture.
        """
        self._frame_size = picture.size
        images = [("/mask", "png", encode_mask(picture.mask))]
        if self._frames != "none":  # a frame before its mask: so a reader has both when it sees the second
            images.insert(0, ("/camera", "jpeg", self._jpeg(picture, captured_ns)))
        messages = []
        for topic, encoding, data in images:
            image = CompressedImage(frame_id="camera", format=encoding, data=data)
            image.timestamp.FromNanoseconds(captured_ns)
            messages.append(Message(topic, wall_ns, image.SerializeToString(), seq))
        return messages

    def step(self, wall_ns: int, captured_ns: int, record: StepRecord) -> list[Message]:
        """Encode a tick.

        Raises:
            TypeError, ValueError: a field cannot be written as JSON.
        """
        asked_and_sent = {"asked": record.command, "sent": record.sent}
        twists = {name: dataclasses.asdict(twist) for name, twist in asked_and_sent.items() if twist}
        messages = [
            Message("/step", wall_ns, step_to_json(record), record.step),
            Message("/command", wall_ns, json.dumps(twists).encode(), record.step),
        ]
        if self._frame_size is not None:
            box = _annotation(record.box, self._frame_size, captured_ns)
            messages.append(Message("/box", wall_ns, box.SerializeToString(), record.step))
        if record.pose is not None:
            pose = _pose(record.pose, wall_ns)
            messages.append(Message("/pose", wall_ns, pose.SerializeToString(), record.step))
        return messages

    def event(self, wall_ns: int, level: str, text: str) -> list[Message]:
        """Encode an event."""
        line = Log(level=_LEVELS[level], message=text, name="adatracker")
        line.timestamp.FromNanoseconds(wall_ns)
        return [Message("/log", wall_ns, line.SerializeToString(), 0)]

    def _jpeg(self, picture: Picture, captured_ns: int) -> bytes:
        content = picture.content
        if self._frames == "blurred":
            content = self._veil.cover(content, picture.mask, captured_ns)
        elif content.ndim == 1:
            return content.tobytes()
        bgr = cv2.cvtColor(content, cv2.COLOR_RGB2BGR)
        _, jpeg = cv2.imencode(".jpg", bgr, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))
        return bytes(jpeg)


def _json_channel(topic: str, name: str, schema: bytes) -> Channel:
    return Channel(topic, "json", name, "jsonschema", schema)


def _foxglove_channel(topic: str, message: Any) -> Channel:
    descriptor = message.DESCRIPTOR
    return Channel(topic, "protobuf", descriptor.full_name, "protobuf", _descriptor_set(descriptor))


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
    turned = Quaternion.of(pose.roll, pose.pitch, pose.yaw)
    orientation.w, orientation.x, orientation.y, orientation.z = turned
    return message
