"""The paper's own results: Table II of AdaTracker, per embodiment in SimpleRoom, as printed."""

from __future__ import annotations

from dataclasses import dataclass

from adatracker_deploy.evaluation.grid import CELLS, Cell

Triple = tuple[float, float, float]
"""AR, EL, SR."""


@dataclass(frozen=True, slots=True)
class Published:
    """A method's row."""

    name: str
    cells: dict[Cell, Triple]
    mean: Triple
    """As printed."""


def _table(name: str, mean: str, *rows: str) -> Published:
    triples = [_triple(text) for row in rows for text in row.split()]
    return Published(name, dict(zip(CELLS, triples, strict=True)), _triple(mean))


def _triple(text: str) -> Triple:
    ar, el, sr = map(float, text.split("/"))
    return ar, el, sr


PUBLISHED = (
    _table(
        "AdaTracker",
        "368/492/0.98",
        "324/500/1.0 336/500/1.0 240/433/0.96 115/494/0.94",
        "432/500/1.0 423/500/1.0 385/495/0.96 282/498/0.98",
        "464/500/1.0 451/500/1.0 424/496/0.98 369/497/0.96",
        "454/500/1.0 433/491/0.96 409/488/0.96 339/476/0.90",
    ),
    _table(
        "Offline EVT",
        "204/451/0.77",
        "200/491/0.94 173/495/0.94 66/468/0.82 27/488/0.92",
        "311/496/0.98 270/490/0.94 111/444/0.6 40/351/0.28",
        "391/500/1.0 370/500/1.0 340/498/0.98 277/500/1.0",
        "337/484/0.9 269/456/0.7 91/311/0.28 4/259/0.08",
    ),
    _table(
        "PID + video tracker",
        "76/322/0.58",
        "362/496/0.98 35/390/0.58 -21/261/0.45 -44/180/0.35",
        "370/496/0.98 40/385/0.55 -32/255/0.40 -33/185/0.38",
        "391/500/1.0 40/395/0.62 -13/270/0.50 -37/190/0.42",
        "198/302/0.6 25/375/0.52 -25/275/0.52 -40/195/0.40",
    ),
)
"""One row a height (0.3, 1.0, 1.7, 3.0 m), in it a triple a target's speed (0.5, 1, 2, 3 m/s)."""
