"""The robot's own camera: sensor_msgs/CompressedImage or Image; keeps only the newest image.

It has a node of its own, because it runs in the tracker's process. A simulated robot's images are paired with
the ground truth of the same stamp.
"""

from __future__ import annotations

import contextlib
import secrets
import threading
import time
from typing import TYPE_CHECKING, Any

import sensor_msgs.msg
import std_msgs.msg

from adatracker_deploy.config.camera_topic import with_camera
from adatracker_deploy.core.camera import OPEN_TIMEOUT_S, ROBOT
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.perception.image import decode_image, is_png
from adatracker_deploy.perception.live import LiveCamera, Picture
from adatracker_deploy.perception.truth_wire import decode_truth
from adatracker_ros2.adapter.graph import NAMELESS, name_of, wrong_publishers
from adatracker_ros2.protocol.connection import Qos
from adatracker_ros2.protocol.messages import (
    IMAGE_CAP_BYTES,
    TYPES,
    read_camera_info,
    read_image,
    read_stamp_ns,
)
from adatracker_ros2.protocol.participant import Participant
from adatracker_ros2.protocol.qos import ros_qos
from adatracker_ros2.protocol.topics import CAMERA_INFO, COMPRESSED_IMAGE, IMAGE, Topics, is_rectified

if TYPE_CHECKING:
    from collections.abc import Generator, Sequence

    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.messages import Truth
    from adatracker_ros2.adapter.graph import Endpoint

_LOOK_S = 0.02
_NAMED_S = 3.0
"""Longest wait for the name of a publisher's node, which follows it in the graph: a refusal tells it."""
_TOLD_S = 1.0
"""Time before the opening ends at which a refusal is told, with the name or without it."""
_WAKE_S = 0.2
"""Longest delay before the reader notices that it should end."""
_TRUTHS_KEPT = 8
"""The truth of an image is published before it, so that only images which are skipped leave theirs behind."""
_TRUTH_S = 0.1
"""Longest wait for one that its image has overtaken."""


def _type_in(there: Sequence[Endpoint]) -> str:
    """Return the type of images that is published; empty if none is."""
    names = [endpoint.topic_type for endpoint in there]
    return next((name for name in (COMPRESSED_IMAGE, IMAGE) if name in names), "")


class Ros2Camera(LiveCamera):
    """Reads the topic after ``robot://``, of whichever of the two types its publisher has."""

    def __init__(self, profile: Profile, clock: Clock) -> None:
        self._connection = with_camera(profile)
        self._topics = Topics(self._connection)
        super().__init__(f"{ROBOT}{self._connection.camera_topic}", clock)
        self._participant: Participant | None = None
        self._newest: tuple[Any, int] | None = None
        self._come = threading.Condition()
        self._rehearsed = bool(self._connection.rehearsal_token)
        self._truths: dict[int, bytes] = {}
        """The newest by their stamps, in a rehearsal."""
        self._go: Any = None

    def go(self) -> None:
        """Let the people of a rehearsal walk; a real robot gets no request."""
        if self._go is not None:
            self._go.publish(std_msgs.msg.Empty())

    def _pictures(self) -> Generator[Picture, None, None]:
        participant = Participant(self._connection, f"adatracker_camera_{secrets.token_hex(4)}")
        try:
            if self._rehearsed:
                self._rehearse(participant)
            type_name = self._type(participant)
            if type_name:
                participant.node.create_subscription(
                    TYPES[type_name], self._topics.camera, self._take, ros_qos(self._connection.camera_qos)
                )
            participant.node.create_subscription(
                TYPES[CAMERA_INFO], self._topics.camera_info, self._take_info, ros_qos(Qos())
            )
            participant.start()
            while not self._ending.is_set():
                with self._come:
                    self._come.wait_for(lambda: self._newest is not None, _WAKE_S)
                    newest, self._newest = self._newest, None
                if newest is None:
                    continue
                try:
                    picture = self._picture(*newest)
                except ValueError:
                    self.dropped += 1
                    continue
                yield picture
        finally:
            self._go = None
            participant.close()

    def _interrupt(self) -> None:
        with self._come:
            self._come.notify_all()

    def _type(self, participant: Participant) -> str:
        """Wait for the topic; return the type of its images, empty if nobody publishes any.

        Raises:
            UsageError: something else is published there, or with another quality of service.
        """
        topic, deadline_s = self._topics.camera, time.monotonic() + OPEN_TIMEOUT_S
        while not (there := participant.node.get_publishers_info_by_topic(topic)):
            if self._ending.is_set() or time.monotonic() > deadline_s:
                return ""
            time.sleep(_LOOK_S)
        named_s = min(time.monotonic() + _NAMED_S, deadline_s - _TOLD_S)
        while NAMELESS in (why := self._unfit(there)) and not self._ending.is_set():
            if time.monotonic() > named_s:
                break
            time.sleep(_LOOK_S)
            there = participant.node.get_publishers_info_by_topic(topic) or there
        if why:
            raise UsageError(f"camera {self.name}: {why}")
        return _type_in(there)

    def _unfit(self, there: Sequence[Endpoint]) -> str:
        """Return why no publisher of the topic can be read; empty if one can."""
        topic, type_name = self._topics.camera, _type_in(there)
        if not type_name:
            what, whose = there[0].topic_type, name_of(there[0])
            return f"{topic} is {what} at {whose}; images are {COMPRESSED_IMAGE} or {IMAGE}"
        why = wrong_publishers(topic, type_name, ros_qos(self._connection.camera_qos), there)
        return why and f"{why}: correct connection.camera_qos"

    def _rehearse(self, participant: Participant) -> None:
        lossless = ros_qos(Qos(reliability="reliable", depth=_TRUTHS_KEPT))
        participant.node.create_subscription(
            sensor_msgs.msg.CompressedImage, self._topics.truth, self._take_truth, lossless
        )
        self._go = participant.node.create_publisher(std_msgs.msg.Empty, self._topics.go, lossless)

    def _take(self, message: Any) -> None:
        with self._come:
            self._newest = (message, self.clock.now_ns())
            self._come.notify_all()

    def _take_info(self, message: Any) -> None:
        with contextlib.suppress(ValueError):  # nothing depends on it; the preflight judges it
            self.lens = read_camera_info(message, rectified=is_rectified(self._topics.camera))

    def _take_truth(self, message: Any) -> None:
        with self._come:
            self._truths[read_stamp_ns(message.header)] = bytes(message.data)
            while len(self._truths) > _TRUTHS_KEPT:
                del self._truths[min(self._truths)]
            self._come.notify_all()

    def _picture(self, message: Any, t_ns: int) -> Picture:
        stamp_ns = read_stamp_ns(message.header)
        if hasattr(message, "encoding"):
            return Picture(read_image(message), t_ns, stamp_ns, self._truth(stamp_ns))
        if len(message.data) > IMAGE_CAP_BYTES:
            raise ValueError(f"an image of {len(message.data)} bytes")
        data = bytes(message.data)
        rgb = decode_image(data)
        return Picture(rgb, t_ns, stamp_ns, self._truth(stamp_ns), None if is_png(data) else data)

    def _truth(self, stamp_ns: int) -> Truth | None:
        """Return the truth of the image with this stamp; None for a real robot's.

        Raises:
            ValueError: it has not come, or it is malformed.
        """
        if not self._rehearsed:
            return None
        with self._come:  # two topics: what was published first need not arrive first
            if not self._come.wait_for(lambda: stamp_ns in self._truths, _TRUTH_S):
                raise ValueError("an image without its truth")
            return decode_truth(self._truths[stamp_ns])
