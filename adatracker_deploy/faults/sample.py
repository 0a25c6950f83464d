"""A sample of the matrix for everyday runs: a cover of it, the same each time. Pure.

For every robot it has each phase at least once, and each fault that its own adapter and wire must notice.
Every other fault is there on one robot at least, as the same code meets it on all; of those that strike the
toolkit's processes, each kind is there on one robot that drives and one that flies. Every night has all rows.
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
    "suspend": "machine",
}
"""Faults that strike the toolkit's processes, by kind: one handler takes them, or one process is struck."""

OWN = (
    *("segmenter_stall", "segmenter_error", "camera_freeze", "camera_gone"),
    *("policy_nan", "policy_inf", "policy_hang", "disk_full", "gc_pause", "cpu_hogs"),
    *("action_jump", "battery_low"),
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
    fault = row.fault
    needs: set[Hashable] = {(platform, "phase", row.phase)}
    if fault in KINDS:
        needs |= {("fault", fault), (flies, "kind", KINDS[fault])}
    elif fault in OWN:
        needs.add(("fault", fault))
    else:
        needs.add((platform, "fault", fault))
    if row.again:
        needs.add("again")
    if row.name in FOUND:
        needs.add(("found", row.name))
    return needs


def _cost(cell: Cell) -> float:
    return FLIGHT_COST if cell.flies else 1.0


def _follows(cell: Cell) -> bool:
    return cell.row.phase is TrialPhase.FOLLOWING
