"""Access to the live view: programs of this machine, and pages of Foxglove or of this machine.

A web page that is open in this machine's browser can reach its loopback, and the browser asks nobody before a
websocket is opened. It says though whose page asks (`Origin`), which a page cannot change, and by which name
the page found this machine (`Host`): a foreign name that leads here is DNS rebinding.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from adatracker_deploy.page.access import OWN_HOST

if TYPE_CHECKING:
    from collections.abc import Sequence

_ORIGIN = re.compile(
    r"https://(app|studio)\.foxglove\.dev|https?://(127\.0\.0\.1|localhost)(:\d{1,5})?|file://", re.ASCII
)
"""``file://`` is a desktop application made of pages, or a page that a user has opened from this machine's
disk; ``null`` may be any page's, in a frame."""


def why_refused(hosts: Sequence[str], origins: Sequence[str]) -> str | None:
    """Return in a sentence why a request with these headers must not be answered; None where it may.

    Args:
        hosts: the values of its `Host` headers, of which there must be one.
        origins: those of its `Origin` headers; none from a program that is not a browser.
    """
    if len(hosts) != 1 or not OWN_HOST.fullmatch(hosts[0]):
        return "This is not the host that was asked for."
    if len(origins) > 1 or any(not _ORIGIN.fullmatch(origin) for origin in origins):
        return "Pages of this origin may not watch."
    return None
