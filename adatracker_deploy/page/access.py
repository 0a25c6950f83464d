"""Access to the operator's page: browsers of this machine that know the run's token.

Every local user and every web page in this machine's browser can reach its loopback. A token that only the
operator's terminal shows keeps out the users; `Host` and `Origin`, which a page cannot forge, keep out pages
of other sites, also where the token has leaked.
"""

from __future__ import annotations

import re
import secrets
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

OWN_HOST = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:\d{1,5})?", re.ASCII | re.IGNORECASE)
"""The names by which local users reach a server here, on any port (tunnels). A foreign name that leads here
is DNS rebinding."""
_BEARER = "Bearer "


def new_token() -> str:
    """Return a token of 128 random bits, of letters that an address may hold."""
    return secrets.token_urlsafe(16)


def foreign(hosts: Sequence[str], origins: Sequence[str]) -> str | None:
    """Return in a sentence why a request with these headers is another site's; None where it is not.

    Args:
        hosts: the values of its `Host` headers, of which there must be one.
        origins: those of its `Origin` headers; none from a program, and from a browser that loads a page.
    """
    if len(hosts) != 1 or not OWN_HOST.fullmatch(hosts[0]):
        return "this page is for its own machine: use 127.0.0.1"
    if any(origin != f"http://{hosts[0]}" for origin in origins):
        return "pages of another origin may ask for nothing here"
    return None


def knows(token: str, authorizations: Sequence[str]) -> bool:
    """Return whether the values of `Authorization` headers show the token (RFC 6750); in constant time."""
    shown = [each.removeprefix(_BEARER) for each in authorizations if each.startswith(_BEARER)]
    return len(shown) == 1 and secrets.compare_digest(shown[0].encode(), token.encode())
