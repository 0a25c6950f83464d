"""A run's training curves: always ``curves.csv``, TensorBoard events if that is installed, other loggers."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

from torch import Tensor

try:
    from torch.utils.tensorboard import SummaryWriter
except ImportError:  # it only draws what curves.csv holds
    SummaryWriter = None  # type: ignore[assignment, misc]

NAME = "curves.csv"
EVERY = 50
"""Updates that a row is the mean of."""


class MetricLogger(Protocol):
    """Keeps a run's curves somewhere else, too."""

    def write(self, update: int, means: Mapping[str, float]) -> None:
        """Take the means, by name, of the `EVERY` updates up to this one."""

    def close(self) -> None:
        """Finish; nothing more comes."""


class TensorBoard:
    """Writes TensorBoard's event files."""

    def __init__(self, out: Path, update: int) -> None:
        self._events = SummaryWriter(out / "tensorboard", purge_step=update + 1)

    def write(self, update: int, means: Mapping[str, float]) -> None:
        """Add a point to each curve."""
        for name, mean in means.items():
            self._events.add_scalar(name, mean, update)

    def close(self) -> None:
        """Finish the file."""
        self._events.close()


class Curves:
    """Takes scalars update by update; a row of ``curves.csv`` is (update, name, mean)."""

    def __init__(self, out: Path, update: int, loggers: Sequence[MetricLogger] = ()) -> None:
        """Go on after `update` updates: what a lost continuation wrote beyond them is dropped."""
        self._path = out / NAME
        rows = _rows(self._path)
        with self._path.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows(
                [("update", "name", "mean"), *(r for r in rows if int(r[0]) <= update)]
            )
        self._sums: dict[str, float] = {}
        self._count = 0
        drawn = [] if SummaryWriter is None else [TensorBoard(out, update)]
        self._loggers: tuple[MetricLogger, ...] = (*drawn, *loggers)

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
        for logger in self._loggers:
            logger.write(update, means)

    def close(self) -> None:
        """Close all loggers."""
        for logger in self._loggers:
            logger.close()


def _rows(path: Path) -> list[list[str]]:
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return [row for row in csv.reader(file) if row and row[0].isdecimal()]
