"""Examples have no time limit of their own: on a busy machine a slow one is not a failure."""

from __future__ import annotations

from hypothesis import settings

settings.register_profile("no-deadline", deadline=None)
settings.load_profile("no-deadline")
