"""The CAN bus, through one of python-can's drivers; only this module and `bus_driver` use python-can.

One thread of our own receives (a python-can ``Notifier`` dies with its first error); frames are stamped when
they arrive, since drivers disagree on time stamps. Whatever ends a bus is latched in `Bus.lost`: nothing is
sent on it any more, and only opening a new one helps.
"""

from __future__ import annotations

import contextlib
import errno
import select
import socket
import threading
import time
from typing import TYPE_CHECKING, Any

import can

from adatracker_deploy.core.errors import PlatformError, line_of
from adatracker_wheeled.protocol.bus_driver import open_driver
from adatracker_wheeled.protocol.frames import CanFrame

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_wheeled.protocol.connection import Connection

STUCK_S = 0.1
"""A bus that takes no frame for so long is lost."""
_LOOK_S = 0.05
"""Polling interval of a silent bus."""
_SEND_TIMEOUT_S = 0.1
_BUS_OFF = 0x40
"""CAN_ERR_BUSOFF in the id of an error frame (linux/can/error.h)."""

_SHARED = "socketcan"
"""Delivers own frames on request alone, and marks what other programs of this machine have sent with
MSG_DONTROUTE (Linux, networking/can.rst, 4.1.7), which python-can takes for an own frame."""


class Bus:
    """An open bus that is listened to.

    Args:
        driver: python-can's bus.
        name: how errors name it, for example ``can0 (socketcan)``.
        hear: called in the receive thread with each data frame, and with None when nothing came for 50 ms and
            when the bus is lost.
        on_message: called with each of python-can's messages that was heard or sent; must return at once.
        shared: the driver echoes nothing, and marks as sent what other programs of this machine have sent.
    """

    def __init__(
        self,
        driver: Any,
        name: str,
        hear: Callable[[CanFrame | None], None],
        on_message: Callable[[Any], None] = lambda _: None,
        *,
        shared: bool = False,
    ) -> None:
        self.lost = ""
        """Reason for the loss of the bus; empty while it works."""
        self.dropped = 0
        """Frames that a full transmit queue did not take; they are not sent later."""
        self.strange = 0
        """Received frames that are not data frames of classic CAN: remote, FD, error, oversized."""
        self._driver = driver
        self._name = name
        self._hear = hear
        self._on_message = on_message
        self._shared = shared
        self._stream = _stream(driver)
        self._sending = threading.Lock()
        self._full_since_s: float | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._listen, name="can-receive", daemon=True)
        self._thread.start()

    @classmethod
    def open(
        cls,
        connection: Connection,
        hear: Callable[[CanFrame | None], None],
        on_message: Callable[[Any], None] = lambda _: None,
    ) -> Bus:
        """Open the bus of a profile's ``connection:``.

        Raises:
            UsageError, PlatformError: as `open_driver`.
        """
        name = f"{connection.channel} ({connection.interface})"
        return cls(open_driver(connection), name, hear, on_message, shared=connection.interface == _SHARED)

    def send(self, frame: CanFrame) -> bool:
        """Send one frame now or never; return whether the bus took it.

        Raises:
            PlatformError: the bus is lost.
        """
        message = can.Message(arbitration_id=frame.id, data=frame.data, is_extended_id=frame.extended)
        with self._sending:
            if self.lost:
                raise PlatformError(self.lost)
            try:
                self._driver.send(message)
            except Exception as error:  # drivers raise what they like; the transmit thread must outlive it
                if not _is_full(error):
                    raise self._lose(line_of(error, 120)) from error
                self.dropped += 1
                now_s = time.monotonic()
                self._full_since_s = self._full_since_s or now_s
                if now_s - self._full_since_s > STUCK_S:
                    raise self._lose(f"it has taken no frame for {STUCK_S:g} s") from error
                return False
            self._full_since_s = None
        message.is_rx = False
        self._on_message(message)
        return True

    def close(self) -> None:
        """Stop listening and release the device; may be called twice."""
        self._closed = True
        self._thread.join()
        with contextlib.suppress(Exception):  # a device that is gone cannot be released any better
            self._driver.shutdown()

    def _listen(self) -> None:
        try:
            while not (self._closed or self.lost):
                message = self._driver.recv(_LOOK_S)
                if message is None and self._stream is not None and _ended(self._stream):
                    self._lose("the far side has closed the connection")  # python-can would spin in silence
                    break
                if message is not None and self._shared:
                    message.is_rx = True
                if message is not None and message.is_rx:  # not our own, where a driver echoes what was sent
                    self._on_message(message)
                self._hear(self._to_frame(message))
        except Exception as error:  # drivers raise what they like; none of it may pass for a silent bus
            self._lose(line_of(error, 120))
        if not self._closed:
            self._hear(None)

    def _to_frame(self, message: Any) -> CanFrame | None:
        if message is None:
            return None
        if message.is_error_frame and message.arbitration_id & _BUS_OFF:
            self._lose("the controller went bus-off: check the wiring, the termination and the bit rate")
            return None
        if not message.is_rx:  # our own, where a driver echoes what was sent
            return None
        try:
            if message.is_error_frame or message.is_remote_frame or message.is_fd:
                raise ValueError("no data frame of classic CAN")
            return CanFrame(message.arbitration_id, bytes(message.data), message.is_extended_id)
        except ValueError:
            self.strange += 1
            return None

    def _lose(self, why: str) -> PlatformError:
        """Latch the first reason."""
        self.lost = self.lost or f"CAN bus {self._name} is lost: {why}"
        return PlatformError(self.lost)


def _stream(driver: Any) -> socket.socket | None:
    """Return the TCP connection that a driver speaks through, if it does; made unable to block for long."""
    for value in vars(driver).values():
        if isinstance(value, socket.socket) and value.type == socket.SOCK_STREAM:
            value.settimeout(_SEND_TIMEOUT_S)
            return value
    return None


def _ended(stream: socket.socket) -> bool:
    """Return whether the other side has closed; takes nothing from the stream."""
    return bool(select.select([stream], [], [], 0)[0]) and stream.recv(1, socket.MSG_PEEK) == b""


def _is_full(error: Exception) -> bool:
    code = getattr(error, "error_code", None) or getattr(error, "errno", None)
    return code == errno.ENOBUFS or "Transmit buffer full" in str(error)
