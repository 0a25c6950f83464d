"""Keys of a simulated robot only, beside its ROS 2 topics.

``sitl/alive``  its liveliness token: this robot is a rehearsal.
``sitl/run/T``  another one, whose T only the rehearsal knows that started this robot.
``sitl/truth``  the truth of each image, under the image's stamp; put before the image is.
``sitl/go``     anything put here lets the people in its world walk.
``sitl/fault``  a `Fault` by name, until the next one.
"""

from __future__ import annotations

import enum
import struct
from typing import TYPE_CHECKING

from adatracker_deploy.core import faults as catalogue
from adatracker_deploy.perception.truth_wire import decode_truth, encode_truth

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Truth
    from adatracker_quadruped.protocol.connection import Connection

TRUTH_CAP_BYTES = 1 << 20
_STAMP = struct.Struct("<q")


class Fault(enum.StrEnum):
    """A fault of a simulated robot, on demand."""

    NONE = "none"
    SILENT = "silent"
    """It sends nothing any more; it still listens."""
    FROZEN_ODOMETRY = "frozen_odometry"
    """Its odometry repeats the last measurement, stamp and all."""
    FROZEN_CAMERA = "frozen_camera"
    """Its camera repeats the last image, stamp and all."""
    LOW_BATTERY = "low_battery"
    TIPPED_OVER = "tipped_over"


ORDERED: dict[str, Fault] = {
    catalogue.ROBOT_SILENT.name: Fault.SILENT,
    catalogue.CAMERA_FREEZE.name: Fault.FROZEN_CAMERA,
    catalogue.BATTERY_LOW.name: Fault.LOW_BATTERY,
    "frozen_odometry": Fault.FROZEN_ODOMETRY,
    "tipped_over": Fault.TIPPED_OVER,
}
"""The same by the names that ``--fault`` takes."""
ON_DEMAND = (
    catalogue.CAMERA_FREEZE,
    catalogue.CAMERA_GONE,
    catalogue.LINK_DROP,
    catalogue.ROBOT_SILENT,
    catalogue.BATTERY_LOW,
    catalogue.Fault("frozen_odometry", "the odometry repeats the last measurement, stamp and all", 2.0),
)
"""All that a rehearsal may ask for; a robot that tips over is refused by the preflight alone."""


class SitlKeys:
    """The keys of one robot, under its namespace."""

    def __init__(self, connection: Connection) -> None:
        base = f"{connection.namespace.strip('/')}/sitl".lstrip("/")
        self.alive = f"{base}/alive"
        self.truth = f"{base}/truth"
        self.go = f"{base}/go"
        self.fault = f"{base}/fault"
        self.run = f"{base}/run/{connection.rehearsal_token}" if connection.rehearsal_token else ""


def encode_stamped_truth(stamp_ns: int, truth: Truth) -> bytes:
    """Return the stamp of its image, ns since 1970 as little-endian int64, with `truth_wire` behind it."""
    return _STAMP.pack(stamp_ns) + encode_truth(truth)


def stamp_of(payload: bytes) -> int:
    """Return the stamp of the image that a truth belongs to."""
    return int.from_bytes(payload[: _STAMP.size], "little", signed=True)


def truth_of(payload: bytes) -> Truth:
    """Return the truth behind the stamp.

    Raises:
        ValueError: it is malformed.
    """
    return decode_truth(payload[_STAMP.size :])
