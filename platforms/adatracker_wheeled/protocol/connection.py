"""The profile's ``connection:`` section: how a wheeled base is reached."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from adatracker_deploy.config.schema import Range
from adatracker_deploy.core.errors import UsageError
from adatracker_wheeled.protocol.roles import Roles


@dataclass(frozen=True, slots=True, kw_only=True)
class Connection:
    """A CAN bus, and what its messages mean; time-outs are the machine's seconds at any clock speed.

    How old the base's messages may become, and when the base stops by itself, stands in ``roles: timing:``.
    """

    interface: str = "socketcan"
    """As python-can names it: socketcan, socketcand, slcan, pcan, kvaser, virtual ..."""
    channel: str = "can0"
    """The bus, as the interface names it: can0, /dev/ttyACM0, PCAN_USBBUS1 ..."""
    bitrate: Annotated[int, Range(10_000, 1_000_000)] = 500_000
    """bit/s; where the system sets it (socketcan) or the far side does (socketcand) it is not used."""
    host: str = "127.0.0.1"
    """Host of a socketcand."""
    port: Annotated[int, Range(1, 65535)] = 29536
    """Port of a socketcand; 29536 is its usual one."""
    roles: Roles
    silence_timeout_s: Annotated[float, Range(0.1, 10)] = 1.0
    """How long to wait for the base's first state when connecting."""
    engage_timeout_s: Annotated[float, Range(0.1, 10)] = 1.0
    """How long the base may take to say that it obeys this side."""
    min_battery: Annotated[float, Range(0, 1)] = 0.2
    """Charge needed to engage; 0 also accepts a base that does not tell it."""
    rehearsal_token: str = ""
    """Set by ``--sitl``: the socketcand must say this, or it is somebody else's and is sent nothing."""

    @property
    def robot(self) -> str:
        """Names the bus: the same in every run on this machine that would drive the same base."""
        match self.interface:
            case "socketcand":
                return f"can:socketcand:{self.host}:{self.port}:{self.channel}"
            case "virtual":  # which no other process reaches
                return f"can:virtual:{os.getpid()}:{self.channel}"
        device = Path(self.channel).resolve() if self.channel.startswith("/") else self.channel
        return f"can:{self.interface}:{device}"

    def __post_init__(self) -> None:
        if self.interface == "udp_multicast":
            raise UsageError(
                "connection: interface udp_multicast sends motion commands to the whole network and loses "
                "some of them silently; use socketcand to reach a bus over a network"
            )
