"""Bus factory: opens python-can's driver for a profile's bus within 2 s, or says why not."""

from __future__ import annotations

import difflib
import errno
import importlib
import inspect
import logging
import re
import socket
import time
from typing import TYPE_CHECKING, Any

import can
import can.interfaces

from adatracker_deploy.core.errors import PlatformError, UsageError, line_of

if TYPE_CHECKING:
    from adatracker_wheeled.protocol.connection import Connection

logging.getLogger("can").addHandler(logging.NullHandler())  # errors are raised; no second line on stderr

ANSWER_TIMEOUT_S = 1.5
"""For a socketcand to answer; python-can would try for 10 s to connect, and wait for ever for an answer."""
_SET_ELSEWHERE = ("socketcan", "socketcand", "udp_multicast", "virtual")
"""Interfaces whose bit rate this side has no say in."""
_PACKAGES = {"canalystii": "canalystii", "cantact": "cantact", "gs_usb": "gs-usb", "slcan": "pyserial"}
"""Packages that provide the drivers in pure Python."""


def open_driver(connection: Connection) -> Any:
    """Return python-can's open bus.

    Raises:
        UsageError: no such interface, a driver that is not installed, settings that it refuses, or a device
            that another program has.
        PlatformError: no such device, or nobody answers; said within 2 s.
    """
    interface = connection.interface
    _check_interface(interface)
    if interface == "socketcand":
        _shake_hands(connection)
    try:
        _check_options(connection)
        return _open(connection)
    except UsageError:
        raise
    except can.CanInterfaceNotImplementedError as error:
        package = f"; pip install {_PACKAGES[interface]}" if interface in _PACKAGES else ""
        raise UsageError(
            f"connection: interface {interface} lacks its driver: {line_of(error, 120)}{package}"
        ) from error
    except (can.CanError, OSError) as error:
        if "library not found" in str(error):  # as pcan says it
            raise UsageError(
                f"connection: interface {interface} lacks its driver: {line_of(error, 120)}; "
                "install its vendor's"
            ) from error
        what = f"CAN bus {connection.channel} ({interface}) cannot be opened: {line_of(error, 120)}"
        if _is_busy(error):
            raise UsageError(f"{what}; end the program that has it, or correct connection.channel") from error
        raise PlatformError(
            f"{what}; plug the adapter in, bring the bus up (ip link set can0 up type can bitrate 500000), "
            "or correct connection.channel"
        ) from error
    except (TypeError, ValueError) as error:
        raise UsageError(
            f"connection: interface {interface} refuses its settings: {line_of(error, 120)}"
        ) from error
    except Exception as error:  # a missing library shows itself as it likes, kvaser's by a NameError
        raise UsageError(
            f"connection: interface {interface} cannot be used here: {line_of(error, 120)}; "
            "install its vendor's driver and library, or name another interface"
        ) from error


def _is_busy(error: BaseException) -> bool:
    """Return whether another program has the device; drivers tell it by number or in words of their own."""
    return getattr(error, "errno", None) == errno.EBUSY or bool(
        re.search(r"\bbusy\b|\bin use\b", str(error), re.IGNORECASE)
    )


def _open(connection: Connection) -> Any:
    options: dict[str, Any] = dict(connection.options)
    if connection.interface == "socketcand":
        options = {"tcp_tune": True} | options | {"host": connection.host, "port": connection.port}
    elif connection.interface not in _SET_ELSEWHERE:
        options |= {"bitrate": connection.bitrate}
    deadline_s = time.monotonic() + ANSWER_TIMEOUT_S
    while True:
        try:
            return can.Bus(
                interface=connection.interface, channel=connection.channel, ignore_config=True, **options
            )
        except can.CanError:
            # On a busy bus python-can takes a frame right behind socketcand's last answer for a wrong answer.
            if connection.interface != "socketcand" or time.monotonic() > deadline_s:
                raise


def _check_interface(interface: str) -> None:
    if interface not in can.VALID_INTERFACES:
        known = sorted(can.VALID_INTERFACES)
        near = difflib.get_close_matches(interface, known, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"it has {', '.join(known)}"
        raise UsageError(f"connection: python-can has no interface {interface!r}; {hint}")


def _check_options(connection: Connection) -> None:
    """Refuse options that the driver does not know: it would ignore them in silence.

    Some drivers take them from ``**kwargs``, so whatever its constructor names anywhere counts as known.
    """
    if not connection.options:
        return
    module, name = can.interfaces.BACKENDS[connection.interface]
    try:
        made = getattr(importlib.import_module(module), name).__init__
    except ImportError:  # opening it says so
        return
    words = set(re.findall(r"\w+", inspect.getsource(made)))
    if unknown := sorted(connection.options.keys() - words):
        known = [
            each
            for each in inspect.signature(made).parameters
            if each not in ("self", "channel", "bitrate", "kwargs")
        ]
        raise UsageError(
            f"connection: options: interface {connection.interface} has no {unknown[0]!r}; "
            f"it has {', '.join(known)}"
        )


def _shake_hands(connection: Connection) -> None:
    """Find out whether a socketcand answers for this bus, and is the right one."""
    host, port, channel = connection.host, connection.port, connection.channel
    what = f"no socketcand answers for {channel} on {host}:{port}"
    deadline_s = time.monotonic() + ANSWER_TIMEOUT_S
    try:
        with socket.create_connection((host, port), ANSWER_TIMEOUT_S) as probe:
            words = [(b"", b"< hi >"), (f"< open {channel} >".encode(), b"< ok >")]
            if token := connection.rehearsal_token:
                words.insert(1, (b"< rehearsal >", f"< rehearsal {token} >".encode()))
            for say, expect in words:
                probe.settimeout(max(0.01, deadline_s - time.monotonic()))
                probe.sendall(say)
                if (answer := probe.recv(64)) != expect:
                    if say == b"< rehearsal >":
                        raise PlatformError(
                            f"what answers on {host}:{port} is not the simulated base that this rehearsal "
                            "has started: nothing was sent to it; rehearse again"
                        )
                    said = repr(answer)[1:40]
                    raise PlatformError(f"{what}: it answers {said}, where {expect.decode()!r} was expected")
    except OSError as error:
        raise PlatformError(
            f"{what} ({line_of(error, 120)}): start it there, or correct connection.host, port and channel"
        ) from error
