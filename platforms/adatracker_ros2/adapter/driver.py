"""Asks the robot's driver node what no topic tells: its own time-out, and whether it is active."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters

from adatracker_ros2.protocol.topics import Topics

if TYPE_CHECKING:
    from adatracker_ros2.protocol.connection import Connection
    from adatracker_ros2.protocol.participant import Participant

_ANSWER_S = 2.0
"""Machine time for all answers; on one network a service answers in milliseconds."""
_POLL_S = 0.01


@dataclass(frozen=True, slots=True)
class DriverAnswer:
    """The driver's answers; None for no answer, or an invalid one."""

    timeout_s: float | None = None
    state: str | None = None
    """Its lifecycle state's label, such as ``active``."""


class Driver:
    """Clients of the driver's services; those that the connection does not name are not made."""

    def __init__(self, participant: Participant, connection: Connection) -> None:
        name = Topics(connection).driver
        self._parameter = connection.timeout_parameter
        self._parameters = self._states = None
        if connection.timeout_parameter:
            self._parameters = participant.node.create_client(GetParameters, f"{name}/get_parameters")
        if connection.lifecycle:
            self._states = participant.node.create_client(GetState, f"{name}/get_state")

    def ask(self) -> DriverAnswer:
        """Ask, and wait for the answers for two seconds at most; not in the participant's own thread."""
        deadline_s = time.monotonic() + _ANSWER_S
        told = _answer(self._parameters, GetParameters.Request(names=[self._parameter]), deadline_s)
        state = _answer(self._states, GetState.Request(), deadline_s)
        return DriverAnswer(
            timeout_s=_number(told.values[0]) if told is not None and told.values else None,
            state=_label(state.current_state) if state is not None else None,
        )


def _answer(client: Any, request: Any, deadline_s: float) -> Any:
    """Return the response to a request; None if none comes in time, or there is nobody to ask."""
    if client is None:
        return None
    while not client.service_is_ready():
        if time.monotonic() > deadline_s:
            return None
        time.sleep(_POLL_S)
    future = client.call_async(request)
    while not future.done():
        if time.monotonic() > deadline_s:
            client.remove_pending_request(future)
            return None
        time.sleep(_POLL_S)
    return future.result()


def _number(value: Any) -> float | None:
    if value.type == ParameterType.PARAMETER_DOUBLE:
        return float(value.double_value)
    return float(value.integer_value) if value.type == ParameterType.PARAMETER_INTEGER else None


def _label(state: Any) -> str:
    return "active" if state.id == State.PRIMARY_STATE_ACTIVE else (state.label or f"state {state.id}")
