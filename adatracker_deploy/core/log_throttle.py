"""Limits how often a repeated event is logged."""

from __future__ import annotations


def worth_logging(told: int, count: int) -> bool:
    """Return whether a count has passed a power of ten (1, 10, 100, ...) since `told`, the count last
    logged."""
    return told < int("1" + "0" * (len(str(count)) - 1)) <= count
