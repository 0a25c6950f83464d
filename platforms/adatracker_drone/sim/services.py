"""MAVLink services unrelated to flight: parameters, the mission list, ping, time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from adatracker_drone.sim.parameters import PARAMETERS, Parameters, from_wire, to_wire
from adatracker_drone.sim.telemetry import Message

_NAMES = list(PARAMETERS)


def answer(message: Message, parameters: Parameters, now_s: float) -> list[Message]:
    """Return the answers to one decoded message `now_s` after power-on; none where it asks nothing known."""
    service = SERVICES.get(message.get_type())
    return [] if service is None else service(message, parameters, now_s)


def _parameter(name: str, parameters: Parameters) -> list[Message]:
    if name not in PARAMETERS:
        return []
    kind = PARAMETERS[name].kind
    value = to_wire(kind, parameters[name])
    index = _NAMES.index(name)
    return [mavlink.MAVLink_param_value_message(name.encode(), value, kind, len(_NAMES), index)]


def _list_parameters(_message: Any, parameters: Parameters, _now_s: float) -> list[Message]:
    return [told for name in _NAMES for told in _parameter(name, parameters)]


def _read_parameter(message: Any, parameters: Parameters, _now_s: float) -> list[Message]:
    by_index = 0 <= message.param_index < len(_NAMES)
    return _parameter(_NAMES[message.param_index] if by_index else message.param_id, parameters)


def _set_parameter(message: Any, parameters: Parameters, _now_s: float) -> list[Message]:
    """Answer with the value that the parameter has now, changed or not."""
    entry = PARAMETERS.get(message.param_id)
    if entry is not None and message.param_type == entry.kind:
        parameters.set(message.param_id, from_wire(entry.kind, message.param_value))
    return _parameter(message.param_id, parameters)


def _list_mission(message: Any, _parameters: Parameters, _now_s: float) -> list[Message]:
    sender = message.get_srcSystem(), message.get_srcComponent()
    return [mavlink.MAVLink_mission_count_message(*sender, 0, message.mission_type)]


def _upload_mission(message: Any, _parameters: Parameters, _now_s: float) -> list[Message]:
    sender = message.get_srcSystem(), message.get_srcComponent()
    answer = mavlink.MAV_MISSION_UNSUPPORTED
    return [mavlink.MAVLink_mission_ack_message(*sender, answer, message.mission_type)]


def _clear_mission(message: Any, _parameters: Parameters, _now_s: float) -> list[Message]:
    sender = message.get_srcSystem(), message.get_srcComponent()
    answer = mavlink.MAV_MISSION_ACCEPTED
    return [mavlink.MAVLink_mission_ack_message(*sender, answer, message.mission_type)]


def _ping(message: Any, _parameters: Parameters, _now_s: float) -> list[Message]:
    if message.target_system != 0:
        return []  # somebody's answer, not a request
    sender = message.get_srcSystem(), message.get_srcComponent()
    return [mavlink.MAVLink_ping_message(message.time_usec, message.seq, *sender)]


def _tell_time(message: Any, _parameters: Parameters, now_s: float) -> list[Message]:
    if message.tc1 != 0:
        return []  # somebody's answer, not a request
    return [mavlink.MAVLink_timesync_message(round(now_s * 1e9), message.ts1)]


SERVICES: dict[str, Callable[[Any, Parameters, float], list[Message]]] = {
    "PARAM_REQUEST_LIST": _list_parameters,
    "PARAM_REQUEST_READ": _read_parameter,
    "PARAM_SET": _set_parameter,
    "MISSION_REQUEST_LIST": _list_mission,
    "MISSION_COUNT": _upload_mission,
    "MISSION_CLEAR_ALL": _clear_mission,
    "PING": _ping,
    "TIMESYNC": _tell_time,
}
"""The handlers of requests, by message type."""
