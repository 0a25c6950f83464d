"""A sample of the matrix for everyday runs: a cover of it, the same each time. Pure.

For every robot it has each phase at least once, at least one second run, and each fault at least once; but a
fault inside the tracker strikes one robot that drives and one that flies. On one of the robots it has each
kind of fault in each phase, each row with conditions of its own, and each row that once found a fault of ours
(docs/safety.md).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from adatracker_deploy.faults.phases import TrialPhase

if TYPE_CHECKING:
    from collections.abc import Hashable, Sequence

    from adatracker_deploy.faults.matrix import Row

KINDS = {
    "interrupt": "operator",
    "terminate": "operator",
    "hangup": "operator",
    "tracker_kill": "tracker",
    "tracker_stop": "tracker",
    "link_kill": "link",
    "link_stop": "link",
}
"""Faults of one kind: one handler takes them, or one process is struck. Any other is a kind by itself."""

IN_THE_TRACKER = (
    *("segmenter_stall", "segmenter_error", "policy_nan", "policy_inf", "policy_hang"),
    *("disk_full", "gc_pause"),
)
"""Faults that the same code meets whatever the robot."""

FOUND = ("tracker_stop", "link_stop", "link_drop")
"""Rows that have found faults of ours where another of their kind had not, or was in time by luck."""

FLIGHT_COST = 2.0
"""Processor time of a drone's row in those of a ground robot's: 12 and 6 s were measured."""


class Cell(NamedTuple):
    """A row of the matrix on one robot."""

    platform: str
    row: Row
    flies: bool


def sampled(cells: Sequence[Cell]) -> list[Cell]:
    """Return the cells of the sample, in their order.

    Greedy: one after the other those that add most for their cost, following first; then those are left out
    whose needs all others meet as well.

    Args:
        cells: the whole matrix, of all robots.
    """
    needs = [_needs(cell) for cell in cells]
    open_needs: set[Hashable] = set().union(*needs)
    chosen: list[int] = []
    while open_needs:
        best = max(
            range(len(cells)),
            key=lambda at: (len(needs[at] & open_needs) / _cost(cells[at]), _follows(cells[at]), -at),
        )
        chosen.append(best)
        open_needs -= needs[best]
    for at in sorted(chosen, key=lambda at: -_cost(cells[at])):
        if needs[at] <= set().union(*(needs[other] for other in chosen if other != at)):
            chosen.remove(at)
    return [cells[at] for at in sorted(chosen)]


def _needs(cell: Cell) -> set[Hashable]:
    """Return what a cell shows."""
    platform, row, flies = cell
    needs: set[Hashable] = {
        (flies if row.fault in IN_THE_TRACKER else platform, "fault", row.fault),
        (platform, "phase", row.phase),
        ("kind", KINDS.get(row.fault, row.fault), row.phase, row.variant),
    }
    if row.again:
        needs.add((platform, "again"))
    if row.name in FOUND:
        needs.add(("found", row.name))
    return needs


def _cost(cell: Cell) -> float:
    return FLIGHT_COST if cell.flies else 1.0


def _follows(cell: Cell) -> bool:
    return cell.row.phase is TrialPhase.FOLLOWING
