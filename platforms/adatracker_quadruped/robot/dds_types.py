"""Unitree's DDS types, made from the message definitions that `protocol` has.

They must be the types of Unitree's own SDK, or DDS does not match them: a ROS ``int8`` is a ``uint8`` there,
and a SportModeState ends with ten path points (unitree_sdk2_python, ``idl/unitree_go/msg/dds_``).
"""

from __future__ import annotations

import dataclasses
import functools
import types as python_types
from typing import Any

from cyclonedds.idl import IdlStruct, types
from cyclonedds.idl.annotations import autoid, final
from rosbags.typesys import get_types_from_msg

from adatracker_quadruped.protocol.cdr import STORE
from adatracker_quadruped.protocol.unitree import SPORT_MODE_STATE

_PATH_POINT = "unitree_go/msg/PathPoint"
STORE.register(
    get_types_from_msg(
        "float32 t_from_start\nfloat32 x\nfloat32 y\nfloat32 yaw\nfloat32 vx\nfloat32 vy\nfloat32 vyaw",
        _PATH_POINT,
    )
)
_APPENDED: dict[str, dict[str, tuple[str, int]]] = {SPORT_MODE_STATE: {"path_point": (_PATH_POINT, 10)}}
_PRIMITIVES: dict[str, Any] = {
    "bool": bool,
    "string": str,
    "int8": types.uint8,
    "uint8": types.uint8,
    "int16": types.int16,
    "uint16": types.uint16,
    "int32": types.int32,
    "uint32": types.uint32,
    "int64": types.int64,
    "float32": types.float32,
}


@functools.cache
def dds_type(type_name: str) -> Any:
    """Return Cyclone DDS's type of a message that `cdr.STORE` knows, such as ``unitree_go/msg/LowState``."""
    _, fields = STORE.fielddefs[type_name]
    members = {name: _member(kind) for name, kind in fields}
    for name, (element, count) in _APPENDED.get(type_name, {}).items():
        members[name] = types.array[dds_type(element), count]
    package, kind, name = type_name.split("/")
    made = python_types.new_class(
        f"{name}_",
        (IdlStruct,),
        {"typename": f"{package}.{kind}.dds_.{name}_"},
        lambda body: body.update(__annotations__=members, __module__=__name__),
    )
    return final(autoid("sequential")(dataclasses.dataclass(made)))


def _member(kind: Any) -> Any:
    """Return the type of a field, by rosbags' description of it: (node type, what it consists of)."""
    node, of = int(kind[0]), kind[1]
    if node == 1:
        return _PRIMITIVES[of[0]]
    if node == 2:
        return dds_type(of)
    if node == 3:
        return types.array[_member(of[0]), of[1]]
    return types.sequence[_member(of[0])]
