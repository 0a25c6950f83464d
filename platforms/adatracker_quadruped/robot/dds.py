"""The node's DDS side: Unitree's sport requests out, its telemetry in, as the CDR that `protocol` reads."""

from __future__ import annotations

import contextlib
import os
import re
from typing import Any

from cyclonedds.core import DDSException, Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.internal import InvalidSample
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_quadruped.protocol import sport, unitree
from adatracker_quadruped.robot.dds_types import dds_type

REQUESTS, SPORT_STATE, LOW_STATE = "rt/api/sport/request", "rt/sportmodestate", "rt/lf/lowstate"
"""DDS topics of a Go2 (unitree_ros2 and unitree_sdk2; ``lf`` is low frequency)."""
_ON_INTERFACE = (
    '<CycloneDDS><Domain Id="any"><General><Interfaces><NetworkInterface name="{}"/></Interfaces></General>'
    "</Domain></CycloneDDS>"
)


class Go2:
    """A Go2's sport service.

    Args:
        interface: network interface of the robot's own network; empty where CYCLONEDDS_URI says it.
        domain: DDS domain; a Go2's is 0.

    Raises:
        UsageError: neither names an interface: DDS would speak on all of them.
        PlatformError: DDS cannot be started there.
    """

    def __init__(self, interface: str, domain: int = 0) -> None:
        if not interface and not os.environ.get("CYCLONEDDS_URI"):
            raise UsageError("--interface is missing: name the one of the robot's own network, such as eth0")
        if interface and not re.fullmatch(r"[A-Za-z0-9_.:-]{1,15}", interface):
            raise UsageError(f"--interface {interface}: is not a network interface, such as eth0")
        try:
            self._domain = Domain(domain, _ON_INTERFACE.format(interface)) if interface else None
            self._participant = DomainParticipant(domain)
            newest = Policy.History.KeepLast(1)
            heard = Qos(Policy.Reliability.BestEffort, newest)
            said = Qos(Policy.Reliability.Reliable(duration(milliseconds=10)), newest)
            self._requests = DataWriter(self._participant, self._topic(REQUESTS, sport.REQUEST), said)
            self._state = DataReader(
                self._participant, self._topic(SPORT_STATE, unitree.SPORT_MODE_STATE), heard
            )
            self._low = DataReader(self._participant, self._topic(LOW_STATE, unitree.LOW_STATE), heard)
        except DDSException as error:
            where = interface or "the interface of CYCLONEDDS_URI"
            raise PlatformError(
                f"DDS does not start on {where}: is it there, and up? ({error.msg})"
            ) from error

    def ask(self, request: bytes) -> None:
        """Send a sport request, as CDR; one that a full queue does not take is lost."""
        with contextlib.suppress(DDSException):
            self._requests.write(dds_type(sport.REQUEST).deserialize(request))

    def state(self) -> bytes | None:
        """Return the newest SportModeState since the last call, as CDR; None without one."""
        return _newest(self._state)

    def low_state(self) -> bytes | None:
        """Return the newest LowState since the last call, as CDR; None without one."""
        return _newest(self._low)

    def _topic(self, name: str, type_name: str) -> Any:
        return Topic(self._participant, name, dds_type(type_name))


def _newest(reader: Any) -> bytes | None:
    samples = [sample for sample in reader.take(4) if not isinstance(sample, InvalidSample)]
    return bytes(samples[-1].serialize(use_version_2=False)) if samples else None
