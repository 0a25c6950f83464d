"""The digest that a file of the Hub's cache is named by.

In a snapshot each file is a link to ``blobs/HASH``: SHA-256 of a large file (LFS, Xet), Git's SHA-1 of a
small one (https://huggingface.co/docs/huggingface_hub/guides/manage-cache). The client itself compares
lengths alone.
"""

from __future__ import annotations

import hashlib
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

_SHA1, _SHA256 = re.compile(r"[0-9a-f]{40}"), re.compile(r"[0-9a-f]{64}")


def is_whole(path: Path) -> bool:
    """Return whether a file's bytes are those that its link's name says.

    True also where there is no such name: the cache was told to make no links, or the endpoint names its
    files otherwise. Then the bundle's own digests remain.
    """
    name = path.readlink().name if path.is_symlink() else ""
    if _SHA256.fullmatch(name):
        digest = hashlib.sha256()
    elif _SHA1.fullmatch(name):
        digest = hashlib.sha1(b"blob %d\0" % path.stat().st_size, usedforsecurity=False)
    else:
        return True
    with path.open("rb") as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest() == name
