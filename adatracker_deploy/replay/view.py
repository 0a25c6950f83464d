"""Shows a replay's results as text and tables, and as one JSON object."""

from __future__ import annotations

import math
from itertools import groupby
from typing import TYPE_CHECKING, Any

from rich import box
from rich.console import Group
from rich.table import Table
from rich.text import Text

from adatracker_deploy.replay.compare import AXES

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from rich.console import RenderableType

    from adatracker_deploy.replay.compare import Spread
    from adatracker_deploy.replay.judged import Judgement
    from adatracker_deploy.replay.trial_again import GateAgain, PolicyAgain


def policy_view(again: PolicyAgain) -> RenderableType:
    """Say whether the answers are the same and, where not, how far they are apart."""
    replayed = again.replayed
    asked = f"policy {again.name}: {_counted(len(replayed.answers), 'tick')} re-run"
    idle = f", {replayed.idle} more were too old to act on" if replayed.idle else ""
    verdict = (
        "every action and every z is the same to the bit"
        if again.first is None
        else f"not the same; first at {again.first.words}"
    )
    parts: list[RenderableType] = [Text(asked + idle), Text(verdict)]
    if again.first is not None:
        rows = {axis: (AXES[axis], spread) for axis, spread in again.apart.items()}
        if again.context_apart is not None:
            rows["z"] = ("", again.context_apart)
        parts.append(_table("its command less the logged one", rows))
    return Group(*parts, *_notes(again.notes))


def gate_view(again: GateAgain) -> RenderableType:
    """Say which limits are others, what they change, and how far the judgement can be believed."""
    parts: list[RenderableType] = [
        Text(f"{name}: {_plain(before)} -> {_plain(after)}")
        for name, (before, after) in again.changed.items()
    ] or [Text("gate: these are the limits of the trial")]
    before, after = again.before.reasons(), again.after.reasons()
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for column in ("changed for", "ticks then", "ticks now", "when, now"):
        table.add_column(column, justify="right" if column.startswith("ticks") else "left")
    for reason in sorted({*before, *after}):
        ticks = after.get(reason, [])
        table.add_row(reason, str(len(before.get(reason, []))), str(len(ticks)), _ranges_text(ticks))
    parts.append(table)
    for name, judgement in (("then", again.before), ("now", again.after)):
        if judgement.stop is not None:
            parts.append(Text(f"{name}: a stop at tick {judgement.ticks[-1].step}: {judgement.stop}"))
    parts.append(
        _table(
            "sent command less the logged one", {axis: (AXES[axis], at) for axis, at in again.apart.items()}
        )
    )
    near = ", ".join(f"{axis} {spread.mean:.2g} {AXES[axis]}" for axis, spread in again.agreement.items())
    parts.append(
        Text(
            "under the trial's own limits this judgement differs from the sent command by, in the "
            f"mean: {near or 'nothing'}"
        )
    )
    return Group(*parts, *_notes(again.notes))


def policy_record(again: PolicyAgain) -> dict[str, Any]:
    """Return it as plain values; a number that is not finite is None."""
    first = again.first
    return {
        "policy": again.name,
        "same_policy": again.same,
        "compared": len(again.replayed.answers),
        "idle": again.replayed.idle,
        "equal": first is None,
        "first_difference": None
        if first is None
        else {
            "tick": first.step,
            "what": first.what,
            "place": first.place,
            "logged": _finite(first.logged),
            "replayed": _finite(first.replayed),
            "by": _finite(first.by),
        },
        "gap": None
        if again.replayed.gap is None
        else {"tick": again.replayed.gap.step, "why": again.replayed.gap.why},
        "differences": _spreads(again.apart),
        "z_difference": None if again.context_apart is None else _spread(again.context_apart),
        "notes": list(again.notes),
    }


def gate_record(again: GateAgain) -> dict[str, Any]:
    """Return it as plain values; ticks are given as pairs of a first and a last."""
    return {
        "limits": {name: {"trial": before, "here": after} for name, (before, after) in again.changed.items()},
        "trial": _judgement(again.before),
        "here": _judgement(again.after),
        "differences": _spreads(again.apart),
        "agreement": _spreads(again.agreement),
        "notes": list(again.notes),
    }


def _judgement(judgement: Judgement) -> dict[str, Any]:
    stop = judgement.stop
    return {
        "ticks": len(judgement.ticks),
        "stop": None if stop is None else {"tick": judgement.ticks[-1].step, "reason": str(stop)},
        "reasons": {str(reason): list(ranges(ticks)) for reason, ticks in judgement.reasons().items()},
    }


def ranges(ticks: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Give the first and the last of each run of consecutive numbers; they are ascending."""
    for _, run in groupby(enumerate(ticks), lambda pair: pair[1] - pair[0]):
        numbers = [number for _, number in run]
        yield numbers[0], numbers[-1]


_SHOWN_RANGES = 4


def _ranges_text(ticks: Sequence[int]) -> str:
    found = list(ranges(ticks))
    shown = ", ".join(f"{a}" if a == b else f"{a} to {b}" for a, b in found[:_SHOWN_RANGES])
    return shown + (f" and {len(found) - _SHOWN_RANGES} more" if len(found) > _SHOWN_RANGES else "")


def _table(caption: str, rows: Mapping[str, tuple[str, Spread]]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for column in (caption, "mean", "most", "at tick"):
        table.add_column(column, justify="left" if column == caption else "right")
    for name, (unit, spread) in rows.items():
        table.add_row(f"{name} {unit}".strip(), f"{spread.mean:.2g}", f"{spread.most:.2g}", str(spread.at))
    return table


def _notes(notes: Sequence[str]) -> list[Text]:
    return [Text(f"note: {note}") for note in notes]


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _plain(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _spreads(spreads: Mapping[str, Spread]) -> dict[str, Any]:
    return {axis: _spread(spread) for axis, spread in spreads.items()}


def _spread(spread: Spread) -> dict[str, Any]:
    return {"mean": _finite(spread.mean), "most": _finite(spread.most), "tick": spread.at}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
