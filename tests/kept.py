"""Memory in use, counted in blocks of Python's allocator: about one for each object.

The difference across a piece of work is what it keeps. The process's peak memory says less: it may be older
than the work, and hides or adds tens of megabytes.
"""

from __future__ import annotations

import gc
import sys


def blocks_in_use() -> int:
    gc.collect()
    return sys.getallocatedblocks()
