"""Reserves a ROS 2 domain of this machine for one rehearsal.

Two rehearsals have no topic in common, but nodes of one domain still hear of each other, and Fast DDS lets a
suspended one delay what the others receive: beside a test that suspends nodes of the same domain, 3 of 12
rehearsals heard no odometry for 0.3 s, in domains of their own none of 12.
"""

from __future__ import annotations

import contextlib
import random
import socket
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import PlatformError

if TYPE_CHECKING:
    from types import TracebackType
    from typing import Self

DOMAINS = range(1, 102)
"""Domains whose ports lie below Linux's ephemeral ports (docs.ros.org, "The ROS_DOMAIN_ID")."""
PORT_BASE, DOMAIN_GAIN, PARTICIPANT_GAIN, UNICAST = 7400, 250, 2, 10
"""Ports on which a domain's participants listen (DDSI-RTPS 2.5, 9.6.2.4)."""
_UNUSED = 2
"""Between the domain's two multicast ports and its participants' ports: bound by nobody but this."""
_PARTICIPANTS = 10
"""A rehearsal has four nodes; whoever comes late has a higher number."""


class ReservedDomain:
    """A domain that has no participant, and that nobody else reserves until `close`.

    Raises:
        PlatformError: every domain is in use.
    """

    def __init__(self) -> None:
        for self.number in random.SystemRandom().sample(DOMAINS, len(DOMAINS)):
            held = _bound(_port(self.number, _UNUSED))
            if held is not None and not _has_participants(self.number):
                self._held = held
                return
            if held is not None:
                held.close()
        raise PlatformError(
            f"every ROS 2 domain of this machine, {DOMAINS[0]} to {DOMAINS[-1]}, is in use: "
            "end rehearsals or nodes that are not needed"
        )

    def close(self) -> None:
        """Give it back; may be called twice."""
        self._held.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _port(domain: int, offset: int) -> int:
    return PORT_BASE + DOMAIN_GAIN * domain + offset


def _has_participants(domain: int) -> bool:
    for participant in range(_PARTICIPANTS):
        taken = _bound(_port(domain, UNICAST + PARTICIPANT_GAIN * participant))
        if taken is None:
            return True
        taken.close()
    return False


def _bound(port: int) -> socket.socket | None:
    """Return a UDP socket at a port of this machine; None where somebody has it."""
    with contextlib.ExitStack() as undo:
        bound = undo.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        try:
            bound.bind(("127.0.0.1", port))
        except OSError:
            return None
        undo.pop_all()
        return bound
