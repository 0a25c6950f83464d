"""Progress display of long work: how much is done, the rate and the time left, on stderr.

A terminal gets one line that changes; a file or a pipe a line now and then, which rich's bars would not give.
"""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, Self, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

Part = TypeVar("Part")

LINE_EVERY_S = 10.0
REDRAW_EVERY_S = 0.2
_MINUTES_FROM_S = 120.0


class Count:
    """Shows how much is done; a context manager, for a terminal's line has an end.

    Args:
        what: is counted.
        begun: how much is done already; None for what the first call says, of work that was resumed.
        now_s: the seconds that the rate is counted in.
    """

    def __init__(
        self, what: str, begun: int | None = None, now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._what = what
        self._now_s = now_s
        self._live = sys.stderr.isatty()
        self._shown_s = now_s()
        self._first = None if begun is None else (begun, self._shown_s)

    def __call__(self, done: int, total: int, note: str = "") -> None:
        """Show that `done` of `total` are, if the last line is old enough; `note` is put behind it."""
        now_s = self._now_s()
        first, first_s = self._first = self._first or (done, now_s)
        last = self._live and done == total
        if not last and now_s - self._shown_s < (REDRAW_EVERY_S if self._live else LINE_EVERY_S):
            return
        self._shown_s = now_s
        rate = (done - first) / (now_s - first_s) if now_s > first_s else 0.0
        line = f"{done} of {total} {self._what}{note}"
        if rate:
            line += f", {rate:.{0 if rate >= 100 else 2}f}/s, {_duration((total - done) / rate)} left"
        self._print(line, end="" if self._live else "\n")

    def say(self, text: str) -> None:
        """Show a line of its own."""
        self._print(text, end="\n")

    def _print(self, line: str, end: str) -> None:
        print(f"\r{line:<70}" if self._live else line, end=end, file=sys.stderr, flush=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        if self._live:
            print(file=sys.stderr)


def counted(parts: Iterable[Part], total: int, what: str) -> Iterator[Part]:
    """Pass `parts` on and show how many have been."""
    with Count(what, begun=0) as count:
        for done, part in enumerate(parts, start=1):
            count(done, total)
            yield part


def _duration(seconds: float) -> str:
    return f"{seconds / 60:.0f} min" if seconds >= _MINUTES_FROM_S else f"{seconds:.0f} s"
