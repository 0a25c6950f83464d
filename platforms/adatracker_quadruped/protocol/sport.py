"""Unitree's sport request, which drives a bare Go2 instead of a Twist.

A request is a ROS 2 message around JSON: ``api_id`` 1008 is Move {"x": forward m/s, "y": left m/s, "z":
counter-clockwise rad/s}, 1003 is StopMove (unitree_sdk2, ``robot/go2/sport/sport_api.hpp``). Some firmware
ignores 1008; then a node on the robot has to take Twists.
"""

from __future__ import annotations

import json
import reprlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from rosbags.typesys import get_types_from_msg

from adatracker_deploy.core.messages import Twist
from adatracker_quadruped.protocol import cdr as protocol
from adatracker_quadruped.protocol.cdr import Malformed
from adatracker_quadruped.protocol.ros_types import FASTEST, refuse_unwalkable

REQUEST = "unitree_api/msg/Request"
STOP_MOVE = 1003
MOVE = 1008

_DEFINITIONS = {
    "unitree_api/msg/RequestIdentity": "int64 id\nint64 api_id",
    "unitree_api/msg/RequestLease": "int64 id",
    "unitree_api/msg/RequestPolicy": "int32 priority\nbool noreply",
    "unitree_api/msg/RequestHeader": "RequestIdentity identity\nRequestLease lease\nRequestPolicy policy",
    REQUEST: "RequestHeader header\nstring parameter\nuint8[] binary",
}
"""As in unitree_ros2, ``cyclonedds_ws/src/unitree/unitree_api/msg``."""
for _name, _definition in _DEFINITIONS.items():
    protocol.STORE.register(get_types_from_msg(_definition, _name))
protocol.STORE.get_msgdef(REQUEST)  # compiled now, not at the first command
_TYPES = protocol.STORE.types


@dataclass(frozen=True, slots=True)
class SportRequest:
    """One request; `twist` is what a Move asks for and None of any other."""

    request_id: int
    """Chosen by the sender, different for each request."""
    api_id: int
    twist: Twist | None = None


def encode_move(twist: Twist, request_id: int) -> bytes:
    """Return the request to walk with this velocity; it has no vertical part.

    Raises:
        PlatformError: a component is NaN, infinite or beyond `FASTEST`.
    """
    refuse_unwalkable(twist)
    walk = {"x": twist.vx, "y": twist.vy, "z": twist.yaw_rate}
    return _encode(MOVE, json.dumps(walk), request_id)


def encode_stop(request_id: int) -> bytes:
    """Return the request to stand."""
    return _encode(STOP_MOVE, "", request_id)


def decode_request(payload: bytes) -> SportRequest:
    """Return the request in a payload.

    Raises:
        Malformed: whatever else the payload is.
    """
    message = protocol.decode(payload, REQUEST)
    identity = message.header.identity
    twist = _twist(message.parameter) if identity.api_id == MOVE else None
    return SportRequest(identity.id, identity.api_id, twist)


def _encode(api_id: int, parameter: str, request_id: int) -> bytes:
    header = _TYPES["unitree_api/msg/RequestHeader"](
        identity=_TYPES["unitree_api/msg/RequestIdentity"](id=request_id, api_id=api_id),
        lease=_TYPES["unitree_api/msg/RequestLease"](id=0),
        policy=_TYPES["unitree_api/msg/RequestPolicy"](priority=0, noreply=True),
    )
    message = _TYPES[REQUEST](header=header, parameter=parameter, binary=np.zeros(0, np.uint8))
    return protocol.encode(message, REQUEST)


def _twist(parameter: str) -> Twist:
    try:
        walk: Any = json.loads(parameter)
        values = [walk[axis] for axis in "xyz"]
    except Exception as error:  # not JSON, nested too deep, a number too long, another shape
        raise Malformed(f"Move without x, y and z: {error}") from error
    if not all(type(value) in (int, float) and abs(value) <= FASTEST for value in values):
        raise Malformed(f"Move with {reprlib.repr(values)}, which is not a velocity")
    vx, vy, yaw_rate = map(float, values)
    return Twist(vx=vx, vy=vy, yaw_rate=yaw_rate)
