"""Progress display of long work in equal parts: how many are done, the rate and the time left."""

from __future__ import annotations

import sys
import time
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

Part = TypeVar("Part")

LINE_EVERY_S = 10.0
REDRAW_EVERY_S = 0.2


def counted(parts: Iterable[Part], total: int, what: str) -> Iterator[Part]:
    """Pass `parts` on and tell on stderr about them: a changing line in a terminal, else one now and then."""
    live = sys.stderr.isatty()
    begin_s = shown_s = time.monotonic()
    for done, part in enumerate(parts, start=1):
        now_s = time.monotonic()
        if now_s - shown_s >= (REDRAW_EVERY_S if live else LINE_EVERY_S) or (live and done == total):
            shown_s = now_s
            rate = done / (now_s - begin_s)
            line = f"{done} of {total} {what}, {rate:.1f}/s, {(total - done) / rate:.0f} s left"
            print(f"\r{line:<60}" if live else line, end="" if live else "\n", file=sys.stderr, flush=True)
        yield part
    if live:
        print(file=sys.stderr)
