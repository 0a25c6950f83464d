"""How often to tell of what repeats."""

from __future__ import annotations


def worth_logging(told: int, count: int) -> bool:
    """Tell whether a count has passed 1, 10, 100, ... since it was `told`: so a flood fills no log."""
    return told < int("1" + "0" * (len(str(count)) - 1)) <= count
