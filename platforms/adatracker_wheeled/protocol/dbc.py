"""Reads DBC files: packs and unpacks messages, with each signal's range and scale.

This is the only module that knows cantools. Numbers are turned here and nowhere else: a value is clipped to
what its signal can say, then rounded to the nearest step, half to even (AgileX's own SDK truncates
towards zero instead, so the same speed can differ from it by one step).
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cantools

from adatracker_deploy.core.errors import UsageError, line_of
from adatracker_wheeled.protocol.frames import CanFrame, Malformed


def agilex_v1(frame_id: int, data: bytes) -> int:
    """Return what a v1 frame's last byte must be: the sum of the id's bytes, the length and the other bytes.

    Source: AgileX ugv_sdk, ``CalcCanFrameChecksumV1`` in src/protocol_v1/agilex_msg_parser_v1.c (fd728d4).
    """
    return ((frame_id & 0xFF) + (frame_id >> 8) + len(data) + sum(data[:-1])) & 0xFF


Raw = int | float
"""A signal's number as its bits say it: int, or float for an IEEE 754 signal."""

_SIZE_CAP_BYTES = 4 << 20
_FLOATS = {16: ("<e", 65504.0), 32: ("<f", 3.4028234663852886e38), 64: ("<d", 1.7976931348623157e308)}
"""struct format and largest number of an IEEE 754 signal, by its bits."""


@dataclass(frozen=True, slots=True)
class Signal:
    """A signal's numbers: value = raw x scale + offset, raw within [low, high]."""

    name: str
    scale: float
    offset: float
    low: Raw
    high: Raw
    float_format: str | None = None
    """The struct format of an IEEE 754 signal; None for a whole number."""

    def to_raw(self, value: float) -> Raw:
        """Return the nearest raw number that can be said; `value` must not be NaN."""
        raw = min(max((value - self.offset) / self.scale, self.low), self.high)
        if self.float_format is None:
            return round(raw)
        return float(struct.unpack(self.float_format, struct.pack(self.float_format, raw))[0])

    def to_value(self, raw: Raw) -> float:
        """Return what a raw number means."""
        return raw * self.scale + self.offset

    def exact(self, value: float) -> Raw | None:
        """Return the raw number that means `value`, or None when there is none."""
        raw = self.to_raw(value)
        return raw if math.isclose(self.to_value(raw), value, rel_tol=1e-6, abs_tol=1e-9) else None

    @property
    def span(self) -> tuple[float, float]:
        """The least and the greatest value."""
        ends = self.to_value(self.low), self.to_value(self.high)
        return min(ends), max(ends)


class Layout:
    """One message of a DBC."""

    def __init__(self, message: Any, dbc: str, checksum: str) -> None:
        self.name: str = message.name
        self.id: int = message.frame_id
        self.extended: bool = message.is_extended_frame
        self.length: int = message.length
        self.dbc = dbc
        if message.is_multiplexed() or not 0 < self.length <= 8:
            raise UsageError(f"{dbc}: message {self.name} is multiplexed, empty or longer than 8 bytes")
        for signal in message.signals:
            if not signal.scale or (signal.is_float and signal.length not in _FLOATS):
                raise UsageError(
                    f"{dbc}: {self.name}.{signal.name} has a scale of 0, or a float's size it is not"
                )
        self._message = message
        self._summed = checksum == "agilex_v1"
        self._signals = {signal.name: _signal(signal) for signal in message.signals}
        self._rest: dict[str, Raw] = dict.fromkeys(self._signals, 0)
        self._used: dict[str, Signal] = {}

    def signal(self, name: str) -> Signal:
        """Return a signal by its name; from now on a frame must have it in range.

        Raises:
            UsageError: the message has none of that name.
        """
        if name not in self._signals:
            raise UsageError(
                f"{self.dbc}: message {self.name} has no signal {name!r}; it has {', '.join(self._signals)}"
            )
        return self._used.setdefault(name, self._signals[name])

    def encode(self, raws: dict[str, Raw]) -> CanFrame:
        """Return the frame that says `raws`, zero in every other signal, with its checksum."""
        data: bytes = self._message.encode({**self._rest, **raws}, scaling=False, strict=False)
        if self._summed:
            data = data[:-1] + bytes([agilex_v1(self.id, data)])
        return CanFrame(self.id, data, self.extended)

    def decode(self, frame: CanFrame) -> dict[str, Raw]:
        """Return every signal of a frame with this message's id.

        Raises:
            Malformed: a wrong length, a wrong checksum, or a signal in use that is NaN or out of its range.
        """
        if len(frame.data) != self.length:
            raise Malformed(f"{self.name}: {len(frame.data)} bytes instead of {self.length}")
        if self._summed and frame.data[-1] != agilex_v1(frame.id, frame.data):
            raise Malformed(f"{self.name}: wrong checksum")
        raws: dict[str, Raw] = self._message.decode(frame.data, decode_choices=False, scaling=False)
        for name, signal in self._used.items():
            if not signal.low <= raws[name] <= signal.high:  # a NaN is not between them either
                raise Malformed(f"{self.name}: {name} is out of its range")
        return raws


def _signal(signal: Any) -> Signal:
    """Take over a cantools signal, its range narrowed to the DBC's minimum and maximum."""
    low: Raw
    high: Raw
    float_format = None
    if signal.is_float:
        float_format, high = _FLOATS[signal.length]
        low = -high
    elif signal.is_signed:
        low, high = -(1 << signal.length - 1), (1 << signal.length - 1) - 1
    else:
        low, high = 0, (1 << signal.length) - 1
    scale, offset = float(signal.scale), float(signal.offset)
    given = [
        (float(bound) - offset) / scale for bound in (signal.minimum, signal.maximum) if bound is not None
    ]
    if len(given) == 2:
        least, most = min(given), max(given)
        if not signal.is_float:  # whole steps inside the bounds; the bounds themselves carry rounding errors
            least, most = math.ceil(least - 1e-6), math.floor(most + 1e-6)
        low, high = max(low, least), min(high, most)
    return Signal(signal.name, scale, offset, low, high, float_format)


class Database:
    """The messages of a DBC file."""

    def __init__(self, dbc: str, checksum: str) -> None:
        """Read a shipped DBC by name, or any DBC by path.

        Raises:
            UsageError: there is no such file, or it is not a DBC.
        """
        self.dbc = dbc
        self._checksum = checksum
        try:
            path = find_dbc(dbc)
            if path.stat().st_size > _SIZE_CAP_BYTES:
                raise UsageError(f"{dbc}: larger than 4 MiB; not a DBC file")
            text = path.read_bytes().decode("cp1252", errors="replace")
            database = cantools.database.load_string(text, database_format="dbc")
        except OSError as error:
            raise UsageError(f"{dbc}: cannot be read: {error.strerror}") from error
        except (cantools.Error, ValueError, KeyError, IndexError) as error:
            raise UsageError(f"{dbc}: is not a DBC file: {line_of(error, 120)}") from error
        self._messages = {message.name: message for message in database.messages}
        self._layouts: dict[str, Layout] = {}

    def layout(self, name: str) -> Layout:
        """Return a message's layout.

        Raises:
            UsageError: the DBC has no such message, or it is one that cannot be used.
        """
        if name not in self._messages:
            raise UsageError(
                f"{self.dbc}: has no message {name!r}; it has {', '.join(self._messages) or 'none'}"
            )
        if name not in self._layouts:
            self._layouts[name] = Layout(self._messages[name], self.dbc, self._checksum)
        return self._layouts[name]


def find_dbc(dbc: str) -> Path:
    """Return the path of a shipped DBC by name, or of any DBC by path, relative to the working directory.

    Raises:
        UsageError: there is no such file.
    """
    shipped = sorted(path.name for path in Path(__file__).parent.glob("*.dbc"))
    if dbc in shipped:
        return Path(__file__).parent / dbc
    path = Path(dbc)
    if not path.is_file():
        raise UsageError(
            f"{dbc}: no such file in {Path.cwd()}; shipped are {', '.join(shipped)}, "
            "a path is relative to the working directory"
        )
    return path
