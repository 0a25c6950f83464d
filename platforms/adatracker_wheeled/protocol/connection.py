"""The profile's ``connection:`` section: how a wheeled base is reached."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from adatracker_deploy.config.schema import Range
from adatracker_deploy.core.errors import UsageError
from adatracker_wheeled.protocol.roles import Roles

_WHICH_DEVICE = ("index", "bus", "address", "serial", "unique_hardware_id", "device_id")
"""Options that say which of several adapters is meant."""
_SET_HERE = frozenset(
    (
        "interface",
        "channel",
        "bitrate",
        "host",
        "port",
        "ignore_config",
        "fd",
        "receive_own_messages",
        "can_filters",
    )
)
"""Arguments of drivers that are no options: they stand elsewhere in the profile, or must be as they are."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Connection:
    """A CAN bus, and what its messages mean; time-outs are the machine's seconds at any clock speed.

    How old the base's messages may become, and when the base stops by itself, stands in ``roles: timing:``.
    """

    interface: str = "socketcan"
    """As python-can names it: socketcan, socketcand, slcan, gs_usb, pcan, kvaser, vector, virtual ..."""
    channel: str | int = "can0"
    """The bus, as the interface names it: can0, /dev/ttyACM0, PCAN_USBBUS1; a number for gs_usb, kvaser,
    vector and ixxat."""
    bitrate: Annotated[int, Range(10_000, 1_000_000)] = 500_000
    """bit/s; where the system sets it (socketcan) or the far side does (socketcand) it is not used."""
    options: dict[str, bool | int | float | str] = field(default_factory=dict)
    """More arguments of python-can's driver, by its own names, such as ``{tty_baudrate: 1000000}`` (slcan),
    ``{serial: 12345, app_name: CANoe}`` (vector) or ``{bus: 1, address: 4}`` (gs_usb)."""
    host: str = "127.0.0.1"
    """Host of a socketcand."""
    port: Annotated[int, Range(1, 65535)] = 29536
    """Port of a socketcand; 29536 is its usual one."""
    roles: Roles
    silence_timeout_s: Annotated[float, Range(0.1, 10)] = 1.0
    """Time-out for the base's first state when connecting."""
    engage_timeout_s: Annotated[float, Range(0.1, 10)] = 1.0
    """Time-out for the base to confirm that it obeys this side."""
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
        device = str(self.channel).partition("@")[0]  # slcan's may end with @BAUD
        device = str(Path(device).resolve()) if device.startswith("/") else device
        which = [f"{name}={self.options[name]}" for name in _WHICH_DEVICE if name in self.options]
        return ":".join(("can", self.interface, device, *which))

    def __post_init__(self) -> None:
        if set_here := sorted(_SET_HERE & self.options.keys()):
            raise UsageError(
                f"connection: options: {set_here[0]} cannot be set there; channel, bitrate, host and port "
                "stand beside options, and the others are the toolkit's"
            )
        if self.interface == "udp_multicast" and self.options.get("hop_limit") != 0:
            raise UsageError(
                "connection: interface udp_multicast sends motion commands to the whole network and loses "
                "some of them silently; use socketcand to reach a bus over a network, or stay on this "
                "machine with options: {hop_limit: 0}"
            )
