"""Chooses the target over several pictures.

One picture is not enough: its best box may be a mistake, and the nearest person may be missed in it while
somebody behind is found. So the chosen person has been seen several times, and nobody whom the rule
would rather choose is in doubt any more. Of whom the detector is not sure, a witness is asked: another
network, which has other weaknesses. Time is passed in; the same pictures give the same choice.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from adatracker_deploy.perception.boxes import overlap

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from adatracker_deploy.perception.roles import Boxes, Instances
    from adatracker_deploy.perception.target.choice import Choice

LEAST_SCORE = 0.2
"""Score of a box that may be somebody; every second one between 0.35 and 0.5 was false on street footage."""
TRUSTED_SCORE = 0.35
"""Least mean score of somebody who is chosen without a witness, or after `PATIENCE_S` despite it."""
SURE_SCORE = 0.5
"""Mean score from which on somebody is there unless a witness refutes it; below, it must vouch for them."""
VOUCHED, REFUTED = 0.9, 0.5
"""Mean probability of a person, by the witness, from which on somebody is there, and below which nobody is.
Of 200 rendered starts with two other people, 198 begin with the right person; by the detector alone 195, four
of the others with a tree."""
TRUSTED_SIGHTS = 3
TRUSTED_S = 0.3
"""Number of sightings, and their time span, before somebody is chosen."""
VOUCHED_S = 1.0
"""Time for which a witness must vouch for somebody below `TRUSTED_SCORE`."""
PATIENCE_S = 2.0
"""Longest time for which the choice waits for somebody in doubt."""
_FORGET_S = 0.5
_SAME = 0.3
"""IoU of one person's boxes in two pictures."""


@dataclass(frozen=True, slots=True)
class _Candidate:
    box: NDArray[np.float32]
    """In fractions of the picture."""
    first_ns: int
    last_ns: int
    scores: float
    """Their sum."""
    sights: int = 1
    votes: float = 0.0
    """The sum of the witness's probabilities."""
    asked: int = 0

    @property
    def score(self) -> float:
        """The mean score."""
        return self.scores / self.sights

    @property
    def vote(self) -> float | None:
        """The witness's mean probability; None before it was asked as often as somebody must be seen."""
        return self.votes / self.asked if self.asked >= TRUSTED_SIGHTS else None

    @property
    def refuted(self) -> bool:
        return self.vote is not None and self.vote < REFUTED

    def stays(self) -> bool:
        """Return whether they have been seen often and long enough."""
        return self.sights >= TRUSTED_SIGHTS and self._seen_for(TRUSTED_S)

    def certain(self, least_score: float) -> bool:
        if not self.stays() or self.refuted:
            return False
        vouched = self.vote is not None and self.vote >= VOUCHED
        return self.score >= least_score or (
            vouched and (self.score >= TRUSTED_SCORE or self._seen_for(VOUCHED_S))
        )

    def _seen_for(self, time_s: float) -> bool:
        return self.last_ns - self.first_ns >= time_s * 1e9

    def heard(self, vote: float) -> _Candidate:
        return replace(self, votes=self.votes + vote, asked=self.asked + 1)


class FirstSight:
    """Watches everybody until one of them is the target.

    Args:
        choice: the rule.
    """

    def __init__(self, choice: Choice) -> None:
        self._choice = choice
        self._candidates: list[_Candidate] = []
        self._begun_ns: int | None = None

    def __call__(
        self,
        people: Instances,
        width: int,
        height: int,
        t_ns: int,
        witness: Callable[[int], float] | None = None,
    ) -> int | None:
        """Return the index in `people` of the target; None while there is no choice yet.

        Args:
            people: everybody in the picture.
            width: of the picture, px.
            height: of the picture, px.
            t_ns: when it was taken, not before the last one.
            witness: says how probably there is a person at an index in `people`; asked once at most.
        """
        places = np.flatnonzero(people.scores >= LEAST_SCORE)
        scale = np.array([width, height, width, height], np.float32)
        boxes = np.asarray(people.boxes[places] / scale, np.float32)
        shown = self._follow(boxes, people.scores[places], t_ns)
        if self._begun_ns is None and len(boxes):
            self._begun_ns = t_ns
        least_score = TRUSTED_SCORE if witness is None else SURE_SCORE
        preferred = self._preferred()
        if witness is not None and preferred in shown:
            candidate = self._candidates[preferred]
            if not candidate.certain(least_score):
                self._candidates[preferred] = candidate.heard(witness(int(places[shown[preferred]])))
                preferred = self._preferred()
        chosen = self._chosen(lambda candidate: candidate.certain(least_score))
        waited = t_ns - (t_ns if self._begun_ns is None else self._begun_ns) >= PATIENCE_S * 1e9
        if chosen is None and waited:
            chosen = self._chosen(lambda candidate: candidate.stays() and candidate.score >= TRUSTED_SCORE)
        if chosen is None or chosen not in shown or not (waited or chosen == preferred):
            return None
        return int(places[shown[chosen]])

    def _follow(self, boxes: Boxes, scores: NDArray[np.float32], t_ns: int) -> dict[int, int]:
        """Take the next picture's boxes; return which candidate has which."""
        known = [old for old in self._candidates if t_ns - old.last_ns <= _FORGET_S * 1e9]
        shown: dict[int, int] = {}
        if known and len(boxes):
            shared = overlap(np.array([old.box for old in known]), boxes)
            for at in np.argsort(-shared, axis=None):
                row, column = divmod(int(at), len(boxes))
                if shared[row, column] < _SAME:
                    break
                if row not in shown and column not in shown.values():
                    shown[row] = column
        for row, column in shown.items():
            old = known[row]
            known[row] = replace(
                old,
                box=boxes[column],
                last_ns=t_ns,
                scores=old.scores + float(scores[column]),
                sights=old.sights + 1,
            )
        for column in set(range(len(boxes))) - set(shown.values()):
            shown[len(known)] = column
            known.append(_Candidate(boxes[column], t_ns, t_ns, float(scores[column])))
        self._candidates = known
        return shown

    def _preferred(self) -> int | None:
        """Return the candidate that the rule would choose if everybody were there who is not refuted."""
        return self._chosen(lambda candidate: not candidate.refuted)

    def _chosen(self, counts: Callable[[_Candidate], bool]) -> int | None:
        """Return the candidate that the rule chooses among those who count."""
        among = [at for at, candidate in enumerate(self._candidates) if counts(candidate)]
        if not among:
            return None
        candidates = [self._candidates[at] for at in among]
        place = self._choice(
            np.array([candidate.box for candidate in candidates], np.float32),
            np.array([candidate.score for candidate in candidates], np.float32),
        )
        return None if place is None else among[place]
