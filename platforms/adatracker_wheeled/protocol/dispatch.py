"""Dispatches received frames to readers by id."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Generic, TypeVar

from adatracker_deploy.core.errors import UsageError
from adatracker_wheeled.protocol.dbc import Layout, Raw
from adatracker_wheeled.protocol.frames import CanFrame
from adatracker_wheeled.protocol.message_codec import Part, Quantities

T = TypeVar("T")
Told = dict[str, Any]
"""Fields of a `Reading` or a `Demand`."""
Reader = Callable[[dict[str, Raw]], Told]


class Gather(Generic[T]):
    """Waits until each of several messages has come, so that new and old parts are never mixed."""

    def __init__(self, size: int) -> None:
        self._missing = self._all = frozenset(range(size))
        self._got: dict[int, T] = {}

    def add(self, index: int, value: T) -> list[T]:
        """Take one part; return all of them once the set is complete, else nothing, and then start over."""
        self._got[index] = value
        self._missing -= {index}
        if self._missing:
            return []
        self._missing = self._all
        return [self._got[each] for each in sorted(self._all)]


class Dispatch:
    """The messages that one side listens to.

    Args:
        padded: a frame may be longer than its message; the bytes at its end are ignored.
    """

    def __init__(self, *, padded: bool = False) -> None:
        self._padded = padded
        self._known: dict[tuple[int, bool], tuple[Layout, list[Reader]]] = {}

    def add(self, layout: Layout, reader: Reader) -> None:
        """Let a reader see every well-formed frame of a message.

        Raises:
            UsageError: another message has the same id.
        """
        known, readers = self._known.setdefault((layout.id, layout.extended), (layout, []))
        if known is not layout:
            raise UsageError(f"{layout.dbc}: {known.name} and {layout.name} have the same id {layout.id:#x}")
        readers.append(reader)

    def add_parts(self, parts: Sequence[Part], tell: Callable[[Quantities], Told]) -> None:
        """Tell what several messages carry together, each time that all of them have come."""
        gather: Gather[Quantities] = Gather(len(parts))
        for index, part in enumerate(parts):
            self.add(part.layout, _part_reader(gather, index, part, tell))

    def knows(self, frame: CanFrame) -> bool:
        """Return whether anybody listens to a frame's id."""
        return (frame.id, frame.extended) in self._known

    def read(self, frame: CanFrame) -> Told | None:
        """Return what a frame tells, or None when nobody listens to its id.

        Raises:
            Malformed: somebody does, and the frame cannot be believed.
        """
        known = self._known.get((frame.id, frame.extended))
        if known is None:
            return None
        layout, readers = known
        if self._padded:
            frame = replace(frame, data=frame.data[: layout.length])
        raws = layout.decode(frame)
        told: Told = {}
        for reader in readers:
            told |= reader(raws)
        return told


def _part_reader(
    gather: Gather[Quantities], index: int, part: Part, tell: Callable[[Quantities], Told]
) -> Reader:
    def read(raws: dict[str, Raw]) -> Told:
        if not part.matches(raws):
            return {}
        complete = gather.add(index, part.read(raws))
        said = {quantity: value for each in complete for quantity, value in each.items()}
        return tell(said) if complete else {}

    return read
