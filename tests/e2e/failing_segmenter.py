"""The command, with a segmenter that goes wrong when the robot has followed for some seconds.

The first argument says how. A file named ``onset`` gets the machine's monotonic time, ns, of when it did.
"""

from __future__ import annotations

import math
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

from adatracker_deploy.cli import main
from adatracker_deploy.core.messages import Box
from adatracker_deploy.perception import segmenters

NOBODY = "nobody"
"""The one that has never seen anybody."""
SIGHTS = 60
STALL_S = 3.0
"""The loop gives up after 2 s; a stall of just that might be over between two of its ticks."""


class FailingSegmenter:
    """The one that was asked for, until it has seen the target so often."""

    def __init__(self, whole, how) -> None:
        self._whole = whole
        self._how = how
        self._seen = 0
        self.needs_truth = whole.needs_truth

    def reset(self):
        self._whole.reset()

    def __call__(self, frame):
        observation = self._whole(frame)
        if self._how == NOBODY:
            return replace(observation, box=None)
        self._seen += observation.box is not None
        if self._seen == SIGHTS:
            Path("onset").write_text(str(time.monotonic_ns()))
            return WRONG[self._how](observation)
        return observation


def stalls(observation):
    threading.Event().wait(STALL_S)
    return observation


def hangs(observation):
    threading.Event().wait()


def raises(observation):
    raise ZeroDivisionError("the network has no weights")


WRONG = {
    "stalls": stalls,
    "hangs": hangs,
    "raises": raises,
    "earlier": lambda seen: replace(seen, seq=seen.seq - 5, t_ns=seen.t_ns - 250_000_000),
    "not a number": lambda seen: replace(seen, box=Box(math.nan, 0.5, 0.2, 0.4)),
}

if __name__ == "__main__":
    how, *arguments = sys.argv[1:]
    opened = segmenters.open_segmenter

    def open_failing(*args, **more):
        segmenter, name = opened(*args, **more)
        return FailingSegmenter(segmenter, how), name

    segmenters.open_segmenter = open_failing
    sys.exit(main(arguments))
