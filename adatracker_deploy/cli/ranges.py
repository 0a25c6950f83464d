"""Argument types for argparse: numbers within a range."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable


def whole(low: int, high: int) -> Callable[[str], int]:
    """Return a type of arguments: whole numbers from `low` to `high`."""

    def convert(text: str) -> int:
        value = int(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{value} is out of range [{low}, {high}]")
        return value

    convert.__name__ = "whole number"
    return convert


def real(low: float, high: float) -> Callable[[str], float]:
    """Return a type of arguments: finite numbers from `low` to `high`."""

    def convert(text: str) -> float:
        value = float(text)
        if not (math.isfinite(value) and low <= value <= high):
            raise argparse.ArgumentTypeError(f"{text} is out of range [{low:g}, {high:g}]")
        return value

    convert.__name__ = "number"
    return convert
