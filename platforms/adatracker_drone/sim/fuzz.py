"""Fuzzing: random and malformed MAVLink datagrams for tests and benchmarks. Pure."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from adatracker_drone.protocol.packets import pack

if TYPE_CHECKING:
    import random
    from collections.abc import Iterator, Mapping

_STRANGE = b"".join(
    struct.pack("<f", value) for value in (float("nan"), float("inf"), float("-inf"), 3e38, 0.0)
)


def datagrams(messages: Mapping[int, int], dice: random.Random) -> Iterator[bytes]:
    """Yield datagrams without end; two in three hold whole frames with any bytes at all in their fields.

    Args:
        messages: ids that are understood at the other end, each with its CRC_EXTRA.
        dice: the source of all of it.
    """
    known = sorted(messages)
    while True:
        match dice.randrange(9):
            case 0:
                yield dice.randbytes(dice.randrange(300))
            case 1:
                frame = _frame(messages, known, dice)
                yield frame[: dice.randrange(len(frame))]
            case 2:
                changed = bytearray(_frame(messages, known, dice))
                changed[dice.randrange(len(changed))] ^= 1 << dice.randrange(8)
                yield bytes(changed)
            case 3:
                yield b"".join(_frame(messages, known, dice) for _ in range(dice.randrange(2, 5))) + b"\xfd"
            case _:
                yield _frame(messages, known, dice)


def _frame(messages: Mapping[int, int], known: list[int], dice: random.Random) -> bytes:
    """Return a frame with the right checksum, most often of the autopilot's own."""
    message = dice.choice(known)
    system, component = (1, 1) if dice.random() < 0.9 else (dice.randrange(256), dice.randrange(256))
    length = dice.randrange(1, 255)
    payload = dice.randbytes(length) if dice.random() < 0.7 else (_STRANGE * 13)[:length]
    return pack(
        message, payload, messages[message], system=system, component=component, number=dice.randrange(256)
    )
