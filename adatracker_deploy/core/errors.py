"""Errors: a bad request; a robot that fails."""

from __future__ import annotations


class UsageError(Exception):
    """The request is wrong. One line says what, where and what to do; exit status 2."""


class PlatformError(Exception):
    """The robot cannot do what was requested. One line that a person can act on; exit status 1."""
