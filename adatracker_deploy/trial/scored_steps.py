"""The ticks of a running trial, kept for its summary in as little memory as they need.

As `StepRecord`s an hour of them would be 150 MB, which the garbage collector walks through while the robot
drives. Here a tick is 146 bytes of one array, and becomes a `ScoredStep` when it is asked for.
"""

from __future__ import annotations

import dataclasses
import struct
from collections.abc import Sequence
from operator import attrgetter
from typing import TYPE_CHECKING, Any, overload

from adatracker_deploy.messages import Box
from adatracker_deploy.trial.record import Latency, ScoredStep

if TYPE_CHECKING:
    from adatracker_deploy.trial.record import StepRecord

_BOX = attrgetter(*(field.name for field in dataclasses.fields(Box)))
_LATENCY = attrgetter(*(field.name for field in dataclasses.fields(Latency)))
_NO_BOX = (None,) * len(dataclasses.fields(Box))
_VALUES = len(_NO_BOX) + len(dataclasses.fields(Latency)) + 2
_ROW = struct.Struct(f"<qqqH{_VALUES}d")
"""Step, time, missed deadlines; a bit for each value that is absent; the values."""


class ScoredSteps(Sequence[ScoredStep]):
    """A list of ticks that can be appended to and read."""

    def __init__(self) -> None:
        self._rows = bytearray()

    def append(self, step: StepRecord | ScoredStep) -> None:
        """Keep what is scored of a tick."""
        box = _NO_BOX if step.box is None else _BOX(step.box)
        values = (*box, *_LATENCY(step.latency), step.distance_m, step.bearing_rad)
        absent = sum(1 << place for place, value in enumerate(values) if value is None)
        known = (0.0 if value is None else value for value in values)
        self._rows += _ROW.pack(step.step, step.t_ns, step.missed_deadlines, absent, *known)

    def __len__(self) -> int:
        return len(self._rows) // _ROW.size

    @overload
    def __getitem__(self, index: int) -> ScoredStep: ...

    @overload
    def __getitem__(self, index: slice) -> list[ScoredStep]: ...

    def __getitem__(self, index: int | slice) -> ScoredStep | list[ScoredStep]:
        if isinstance(index, slice):
            return [self._at(place) for place in range(len(self))[index]]
        return self._at(range(len(self))[index])

    def _at(self, place: int) -> ScoredStep:
        step, t_ns, missed, absent, *numbers = _ROW.unpack_from(self._rows, place * _ROW.size)
        values: list[Any] = [None if absent >> bit & 1 else number for bit, number in enumerate(numbers)]
        box, latency, (distance_m, bearing_rad) = values[:4], values[4:-2], values[-2:]
        return ScoredStep(
            step=step,
            t_ns=t_ns,
            box=None if box[0] is None else Box(*box),
            latency=Latency(**dict(zip(Latency.__slots__, latency, strict=True))),
            missed_deadlines=missed,
            distance_m=distance_m,
            bearing_rad=bearing_rad,
        )
