"""The page's frame: head, style, and elements shared by trials and sets."""

from __future__ import annotations

import base64
from importlib.resources import files
from typing import TYPE_CHECKING

from adatracker_deploy import __version__
from adatracker_deploy.report.markup import Html, tag

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from adatracker_deploy.core.record import Outcome

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'"
"""Should any text ever get through as markup, the browser still runs no script and asks nobody."""

MISSING = "-"


def page(title: str, *sections: Html | None) -> str:
    """Return a whole HTML document."""
    style = Html(files(__package__).joinpath("page.css").read_text(encoding="utf-8"))
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=_POLICY),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name="color-scheme", content="light dark"),
        tag("title", title),
        tag("style", style),
    )
    foot = tag("footer", f"adatracker-deploy {__version__}")
    body = tag("body", tag("main", *sections), foot)
    return f"<!doctype html>\n{tag('html', head, body, lang='en')}\n"


def section(title: str, *parts: str | None, class_: str | None = None) -> Html:
    """Return a part of the page with its heading."""
    return tag("section", tag("h2", title), *parts, class_=class_)


def badge(outcome: Outcome | str) -> Html:
    """Return an outcome; green is kept for what was completed."""
    look = "good" if outcome == "completed" else "poor" if outcome in ("lost", "interrupted") else "bad"
    return tag("span", outcome.replace("_", " "), class_=f"badge {look}")


def tiles(values: Iterable[tuple[str, str, str]]) -> Html:
    """Return figures to be seen at once: name, value, and a remark that may be empty."""
    return tag(
        "dl",
        *(
            tag("div", tag("dt", name), tag("dd", value, tag("small", remark) if remark else None))
            for name, value, remark in values
        ),
        class_="tiles",
    )


def table(head: Sequence[str], rows: Iterable[Sequence[str]], *, class_: str | None = None) -> Html:
    """Return a table, which scrolls by itself where it is wider than the screen."""
    body = (tag("tr", *(tag("td", cell) for cell in row)) for row in rows)
    top = tag("thead", tag("tr", *(tag("th", cell, scope="col") for cell in head)))
    whole = tag("table", top, tag("tbody", *body), class_=class_)
    return tag("div", whole, class_="scroll")


def picture(jpeg: bytes, words: str) -> Html:
    """Return a JPEG as part of the page."""
    return tag("img", src=f"data:image/jpeg;base64,{base64.b64encode(jpeg).decode()}", alt=words)


def figure(value: float | None, digits: int, unit: str = "") -> str:
    """Write a figure, or that there is none."""
    return MISSING if value is None else f"{value:.{digits}f}{' ' if unit else ''}{unit}"


def shortened(text: str, longest: int) -> str:
    """Return a text, cut where it is longer than anybody reads."""
    return text if len(text) <= longest else f"{text[:longest]}... ({len(text)} characters)"
