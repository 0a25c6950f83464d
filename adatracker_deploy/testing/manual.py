"""Compares sent bytes with the vendor's manual: the part of the suite that no simulator can stand in for.

A simulated robot is made of the same protocol module as its adapter, so what is wrong in that is right on
both sides. Only bytes from elsewhere show it.
"""

from __future__ import annotations

import contextlib
import pkgutil
from typing import TYPE_CHECKING, Any, ClassVar
from unittest import mock

from adatracker_deploy.core.messages import ZERO, Twist
from adatracker_deploy.platform import Platform
from adatracker_deploy.testing.driving import drive

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


class AgainstTheManual:
    """One test and what it needs to know; `conformance.PlatformConformance` has it."""

    manual: ClassVar[Mapping[Twist, str | tuple[str, ...]]] = {}
    """Velocities, and the bytes by which each goes out, in hexadecimal: from the vendor's manual, never from
    the code under test. The part that carries the velocity is enough; all of several parts must go out."""
    says: ClassVar[str] = ""
    """The function or method, ``module:name``, that makes or takes the bytes which go out on this side."""

    def test_the_bytes_on_the_wire_are_those_of_the_manual(self, engaged: Platform) -> None:
        """A sign or a scale that is wrong in code which both sides share shows only against the manual."""
        assert self.manual, (
            "name what the vendor's manual makes of some velocities: manual = {Twist(...): ...}"
        )
        assert self.says, "name what makes or takes the bytes that go out: says = 'my_robot.wire:encode'"
        for command, parts in self.manual.items():
            with self._listen() as said:
                drive(engaged, command, 0.3 * engaged.clock.speed)
                drive(engaged, ZERO, 0.1)
            for part in (parts,) if isinstance(parts, str) else parts:
                newest = said[-12].hex(" ") if len(said) > 12 else said
                assert any(bytes.fromhex(part) in packet for packet in said), (
                    f"{command} never went out as {part}; one of {len(said)} packets was {newest}"
                )

    def said(self, *values: Any) -> bytes:
        """Return the bytes of one call of `says`: the last ones among its arguments and its result.

        Args:
            values: what it was called with, its ``self`` too, and what it returned.
        """
        return next(
            (bytes(v) for v in reversed(values) if isinstance(v, bytes | bytearray | memoryview)), b""
        )

    @contextlib.contextmanager
    def _listen(self) -> Iterator[list[bytes]]:
        """Give a list of all that `says` says meanwhile."""
        module, _, name = self.says.partition(":")
        place, _, last = name.rpartition(".")
        owner = pkgutil.resolve_name(f"{module}:{place}" if place else module)
        original, said = getattr(owner, last), []

        def overheard(*arguments: Any, **named: Any) -> Any:
            result = original(*arguments, **named)
            said.append(self.said(*arguments, *named.values(), result))
            return result

        with mock.patch.object(owner, last, overheard):
            yield said
