"""A run's training curves: always ``curves.csv``, and TensorBoard events if that is installed."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from torch import Tensor

try:
    from torch.utils.tensorboard import SummaryWriter
except ImportError:  # it only draws what curves.csv holds
    SummaryWriter = None  # type: ignore[assignment, misc]

NAME = "curves.csv"
EVERY = 50
"""Updates that a row is the mean of."""


class Curves:
    """Takes scalars update by update; a row of ``curves.csv`` is (update, name, mean)."""

    def __init__(self, out: Path, update: int) -> None:
        """Go on after `update` updates: what a lost continuation wrote beyond them is dropped."""
        self._path = out / NAME
        rows = _rows(self._path)
        with self._path.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows(
                [("update", "name", "mean"), *(r for r in rows if int(r[0]) <= update)]
            )
        self._sums: dict[str, float] = {}
        self._count = 0
        self._events: Any = None
        if SummaryWriter is not None:
            self._events = SummaryWriter(out / "tensorboard", purge_step=update + 1)

    def add(self, update: int, values: Mapping[str, Tensor | float]) -> None:
        """Take the scalars of one update, and write a row each when `EVERY` have come."""
        for name, value in values.items():
            self._sums[name] = self._sums.get(name, 0.0) + float(value)
        self._count += 1
        if update % EVERY == 0:
            self._write(update, {name: total / self._count for name, total in self._sums.items()})
            self._sums, self._count = {}, 0

    def _write(self, update: int, means: Mapping[str, float]) -> None:
        with self._path.open("a", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows((update, name, f"{mean:.6g}") for name, mean in means.items())
        if self._events is not None:
            for name, mean in means.items():
                self._events.add_scalar(name, mean, update)

    def close(self) -> None:
        """Finish TensorBoard's file."""
        if self._events is not None:
            self._events.close()


def _rows(path: Path) -> list[list[str]]:
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return [row for row in csv.reader(file) if row and row[0].isdecimal()]
