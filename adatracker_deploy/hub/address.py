"""Addresses of repositories on the Hugging Face Hub: ``hf://[datasets/]OWNER/NAME[@REVISION]``.

A part of the grammar of the Hub's own URIs
(https://huggingface.co/docs/huggingface_hub/package_reference/hf_uris).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Literal

from adatracker_deploy.core.errors import UsageError

SCHEME = "hf://"
EXPECTED = f"{SCHEME}OWNER/NAME[@REVISION] or {SCHEME}datasets/OWNER/NAME[@REVISION]"

Kind = Literal["model", "dataset"]

_PREFIXES: dict[str, Kind] = {"models/": "model", "datasets/": "dataset"}
_NAME = r"[A-Za-z0-9](?:[A-Za-z0-9._-]{0,94}[A-Za-z0-9])?"
_ADDRESS = re.compile(
    rf"{SCHEME}(?P<prefix>models/|datasets/)?(?P<repo>{_NAME}/{_NAME})(?:@(?P<revision>\w[\w./-]{{0,198}}))?",
    re.ASCII,
)
_COMMIT = re.compile(r"[0-9a-f]{40}")


@dataclass(frozen=True, slots=True, kw_only=True)
class HubAddress:
    """A repository on the Hub, at a revision."""

    kind: Kind
    repo: str
    """``OWNER/NAME``."""
    revision: str = "main"
    """A branch, a tag or a commit."""

    @property
    def commit(self) -> str | None:
        """The commit that the revision itself names, which nobody can move; else None."""
        return self.revision if _COMMIT.fullmatch(self.revision) else None

    def at(self, revision: str) -> HubAddress:
        """Return the same repository at another revision."""
        return replace(self, revision=revision)

    def __str__(self) -> str:
        """Return it as it is typed."""
        prefix = "datasets/" if self.kind == "dataset" else ""
        return f"{SCHEME}{prefix}{self.repo}@{self.revision}"


def is_hub(text: str) -> bool:
    """Return whether this is meant as an address on the Hub."""
    return text.startswith(SCHEME)


def parse_address(text: str) -> HubAddress:
    """Read an address.

    Raises:
        UsageError: it is none.
    """
    found = _ADDRESS.fullmatch(text)
    revision = (found and found["revision"]) or "main"
    # The revision becomes a file's name in the cache; the Hub allows no repository such a name.
    if found is None or any(re.search(r"\.\.|--", part) for part in (found["repo"], revision)):
        raise UsageError(f"{text!r} is no address on the Hub: expected {EXPECTED}")
    return HubAddress(
        kind=_PREFIXES[found["prefix"] or "models/"],
        repo=found["repo"],
        revision=revision,
    )
