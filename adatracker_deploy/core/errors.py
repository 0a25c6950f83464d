"""The two ways in which what was asked for can fail."""

from __future__ import annotations


class UsageError(Exception):
    """What was asked for is wrong: one line that says what, where and what to do; exit status 2."""


class PlatformError(Exception):
    """The robot cannot do what was asked of it: one line a person can act on; exit status 1."""
