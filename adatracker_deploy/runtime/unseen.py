"""Counts why the target is not seen, for the reason that a trial gives for its end."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.core.messages import MaskClass

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Seen

PEOPLE = "people in sight, none of them the target"
NOBODY = "nobody in sight"


class Unseen:
    """Counts the steps in a row in which the target was not seen, and their causes."""

    def __init__(self) -> None:
        self._causes: Counter[str] = Counter()

    @property
    def steps(self) -> int:
        """Number of those steps."""
        return self._causes.total()

    def add(self, seen: Seen) -> None:
        """Take the next step that was acted on."""
        if seen.observation.box is not None:
            self._causes.clear()
        else:
            self._causes[_cause(seen)] += 1

    def __str__(self) -> str:
        causes = [f"{cause} in {count}" for cause, count in self._causes.most_common()]
        return f"the target was not seen for {self.steps} steps: {', '.join(causes)}"


def _cause(seen: Seen) -> str:
    """Return the truth's word, where it is known, or what was seen instead."""
    if seen.sight is not None:
        return seen.sight.verdict.words
    return PEOPLE if np.any(seen.observation.mask == MaskClass.PERSON) else NOBODY
