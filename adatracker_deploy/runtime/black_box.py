"""Black box: the link's last 30 s, in a file that outlives the tracker and the link.

A ring of slots, each with a number and a checksum: the newest set-point and the link's status, as passed
through shared memory, with the machine's two clocks. A slot reaches the kernel within milliseconds and then
survives the death of every process here, but not a power cut.
"""

from __future__ import annotations

import contextlib
import os
import struct
import threading
import time
import zlib
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from adatracker_deploy.runtime.link import RATE_HZ
from adatracker_deploy.runtime.wire import unpack_setpoint, unpack_status

if TYPE_CHECKING:
    from pathlib import Path

    from adatracker_deploy.runtime.gate import Setpoint
    from adatracker_deploy.runtime.link import LinkStatus

FILE_NAME = "black_box.bin"
"""Name in the trial's folder."""
SECONDS = 30
_SLOTS = round(2 * SECONDS * RATE_HZ)
"""The link steps twice a slot of its own at most."""
_SLOT_BYTES = 1024
_MAGIC = b"adatracker-deploy black box 1\n"
_HEAD = struct.Struct("<QHI")
"""Slot number from 1, length of the payload, its CRC-32."""
_TIMES = struct.Struct("<QQH")
"""CLOCK_MONOTONIC and CLOCK_BOOTTIME in ns, length of the set-point; set-point and status follow."""


@dataclass(frozen=True, slots=True)
class Moment:
    """One step of the link."""

    monotonic_ns: int
    boottime_ns: int
    """Ahead of the monotonic clock by the total time suspended."""
    setpoint: Setpoint | None
    """The newest set-point that the link had received; None before the first."""
    status: LinkStatus


class BlackBox:
    """Writes the ring from its own thread, so that recording never waits for a disk.

    Args:
        path: the file to create; only this user can read it.

    Raises:
        OSError: it cannot be created.
    """

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        os.write(self._fd, _MAGIC)
        self._count = 0
        self._waiting: deque[bytes] = deque(maxlen=_SLOTS)
        self._news = threading.Event()
        self._closed = False
        self._thread = threading.Thread(target=self._write, name="black box", daemon=True)
        self._thread.start()

    def record(self, setpoint: bytes | None, status: bytes) -> None:
        """Record a set-point and a status, as packed by `runtime.wire`; never blocks."""
        monotonic_ns = time.monotonic_ns()
        boottime_ns = time.clock_gettime_ns(getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC))
        told = setpoint or b""
        self._waiting.append(_TIMES.pack(monotonic_ns, boottime_ns, len(told)) + told + status)
        self._news.set()

    def close(self) -> None:
        """Write what is still queued; may be called twice."""
        self._closed = True
        self._news.set()
        self._thread.join(1.0)

    def _write(self) -> None:
        while not self._closed or self._waiting:
            self._news.wait()
            self._news.clear()
            while self._waiting:
                self._put(self._waiting.popleft())
        os.close(self._fd)

    def _put(self, record: bytes) -> None:
        packed = zlib.compress(record, 1)
        if _HEAD.size + len(packed) > _SLOT_BYTES:
            return  # texts longer than any robot's: better to lose this step than two
        self._count += 1
        head = _HEAD.pack(self._count, len(packed), zlib.crc32(packed, self._count & 0xFFFFFFFF))
        place = len(_MAGIC) + self._count % _SLOTS * _SLOT_BYTES
        with contextlib.suppress(OSError):  # a full disk must not stop the robot
            os.pwrite(self._fd, head + packed, place)


def read_black_box(path: Path) -> tuple[Moment, ...]:
    """Return a black box's records, oldest first; incomplete slots are skipped.

    Raises:
        OSError: it cannot be read.
        ValueError: it is not a black box.
    """
    data = path.read_bytes()
    if not data.startswith(_MAGIC):
        raise ValueError(f"{path}: is not a black box")
    found: dict[int, Moment] = {}
    for place in range(len(_MAGIC), len(data) - _HEAD.size, _SLOT_BYTES):
        number, length, checksum = _HEAD.unpack_from(data, place)
        packed = data[place + _HEAD.size :][: min(length, _SLOT_BYTES - _HEAD.size)]
        if number == 0 or zlib.crc32(packed, number & 0xFFFFFFFF) != checksum:
            continue
        with contextlib.suppress(ValueError, KeyError, TypeError, struct.error, zlib.error):
            found[number] = _moment(packed)
    return tuple(found[number] for number in sorted(found))


def _moment(packed: bytes) -> Moment:
    decoder = zlib.decompressobj()
    record = decoder.decompress(packed, 64 * _SLOT_BYTES)  # a forged slot must not fill the memory
    monotonic_ns, boottime_ns, told_bytes = _TIMES.unpack_from(record)
    told, done = record[_TIMES.size :][:told_bytes], record[_TIMES.size + told_bytes :]
    return Moment(monotonic_ns, boottime_ns, unpack_setpoint(told) if told else None, unpack_status(done))
