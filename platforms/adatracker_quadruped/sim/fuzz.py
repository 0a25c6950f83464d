"""Fuzzing: mutated and truncated messages for tests and benchmarks. Pure."""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING

from adatracker_deploy.core.messages import ZERO
from adatracker_quadruped.protocol.messages import Malformed, decode_twist

if TYPE_CHECKING:
    import random
    from collections.abc import Iterator

_LENGTHS = (0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0xFFFFFFFC, 4096, 1 << 24)
_DOUBLES = (math.nan, math.inf, -math.inf, 1e308, -1e9, 5e-324)
_LARGEST = 1 << 20
_LARGE_SHARE = 2e-4


def mutate(valid: bytes, dice: random.Random) -> bytes:
    """Return rubbish, a cut message, or a valid payload with bytes, a length or a double changed."""
    payload = bytearray(valid)
    match dice.randrange(6):
        case 0:
            return dice.randbytes(dice.randrange(1200))
        case 1:
            return valid[:4] + dice.randbytes(dice.randrange(1200))
        case 2:
            return valid[: dice.randrange(len(valid))]
        case 3:
            for _ in range(dice.randrange(1, 5)):
                payload[dice.randrange(len(payload))] = dice.randrange(256)
        case 4:
            at = 4 * dice.randrange(len(payload) // 4)
            struct.pack_into("<I", payload, at, dice.choice(_LENGTHS))
        case 5:
            at = 4 + 4 * dice.randrange(max(1, len(payload) // 4 - 3))
            struct.pack_into("<d", payload, at, dice.choice(_DOUBLES))
    return bytes(payload) + dice.randbytes(dice.choice([0, 0, 1, 64]))


def payloads(valid: bytes, dice: random.Random) -> Iterator[bytes]:
    """Yield mutations of one payload without end; now and then one of up to a megabyte.

    None is a command to move: whoever may command a robot could rightly move it.
    """
    while True:
        behind = dice.randrange(_LARGEST) if dice.random() < _LARGE_SHARE else 0
        payload = mutate(valid, dice) + bytes(behind)
        if not _asks_for_motion(payload):
            yield payload


def _asks_for_motion(payload: bytes) -> bool:
    try:
        return decode_twist(payload) != ZERO
    except Malformed:
        return False
