"""Errors: a bad request; a robot that fails."""

from __future__ import annotations


class UsageError(Exception):
    """The request is wrong. One line says what, where and what to do; exit status 2."""


class PlatformError(Exception):
    """The robot cannot do what was requested. One line that a person can act on; exit status 1."""


_TRACEBACK = "Traceback (most recent call last)"


def line_of(error: BaseException, most: int = 300) -> str:
    """Return another library's error as one line, to put into a sentence of ours.

    It is the error's text, of at most `most` characters, without line breaks and without the traceback that
    some libraries add to it; where it has no text, the error's type. The system's errors are told by the file
    that they are about and in its words, without their number.
    """
    text, about = getattr(error, "strerror", None), getattr(error, "filename", None)
    text = f"{about}: {text}" if text and about is not None else text or str(error)
    line = " ".join(str(text).partition(_TRACEBACK)[0].split())
    return line[:most].rstrip(". ") or type(error).__name__
