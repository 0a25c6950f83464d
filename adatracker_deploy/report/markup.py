"""Injection-safe HTML: everything that is not `Html` already is escaped as text."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

_VOID = frozenset({"img", "meta"})
_KEPT = frozenset("\n\t")


class Html(str):
    """Text that is HTML; made by this module alone, and lost by any ordinary operation on it."""

    __slots__ = ()


def escaped(text: str) -> Html:
    """Escape a text for element content and quoted attributes.

    Characters that cannot be seen (control codes, overrides of the writing direction, halves of surrogate
    pairs as they come from file names) are replaced, for they could show something else than was written.
    """
    seen = text if text.isprintable() else "".join(c if c.isprintable() or c in _KEPT else "�" for c in text)
    return Html(html.escape(seen, quote=True))


def join(parts: Iterable[str]) -> Html:
    """Put parts one after the other, escaping those that are not HTML."""
    return Html("".join(part if isinstance(part, Html) else escaped(part) for part in parts))


def tag(name: str, /, *children: str | None, **attributes: str | float | None) -> Html:
    """Make an element.

    Args:
        name: of the element.
        children: `Html` or text; None is left out.
        attributes: by name, ``class_`` for ``class`` and ``aria_label`` for ``aria-label``; None is left out.
    """
    stated = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escaped(str(value))}"'
        for key, value in attributes.items()
        if value is not None
    )
    if name in _VOID:
        return Html(f"<{name}{stated}>")
    return Html(f"<{name}{stated}>{join(child for child in children if child is not None)}</{name}>")
