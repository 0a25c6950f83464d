"""Fuzzing: random CAN frames for tests and benchmarks. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_wheeled.protocol.frames import CanFrame

if TYPE_CHECKING:
    import random
    from collections.abc import Iterator, Sequence

_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 8, 8, 8)


def frames(known: Sequence[int], dice: random.Random) -> Iterator[CanFrame]:
    """Yield frames with random data without end, three in four under an id that somebody listens to."""
    while True:
        number = dice.choice(known) if dice.random() < 0.75 else dice.randrange(1 << 11)
        yield CanFrame(number, dice.randbytes(dice.choice(_LENGTHS)))
