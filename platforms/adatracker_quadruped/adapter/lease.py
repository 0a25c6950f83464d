"""Lease: one host at a time controls the robot, by liveliness tokens at its router.

``TOKEN``            is declared by the owner alone: a robot that watches it stops when its owner dies.
``TOKEN/claim/ZID``  is declared by a host that wants to own it, *before* it looks for others.
``TOKEN/owner/ZID``  is the owner's too, and distinguishes two owners.

A host with a claim waits for `SETTLE_S` and then looks. If there is an owner, or a claim of a session with a
smaller id, it gives up its claim; otherwise it becomes the owner. A claim reaches the others within
milliseconds, so of two that claim at once at least one sees the other, and both judge alike. Should there be
two owners all the same (one was stopped in the midst of its claim, or cut off from the router and came back),
the one with the larger id sees that it has lost.
"""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

import zenoh

if TYPE_CHECKING:
    from collections.abc import Callable

SETTLE_S = 0.3
"""Longer than a token, or its removal, takes to reach another host."""
_POLL_S = 0.02
_LATE_S = 0.1
"""After a longer delay between looks, the whole settling time starts again."""
_MOST_OTHERS = 64
"""Cap on tokens: invented ones must not fill the memory."""


class Lease:
    """One host's lease on the robot.

    Args:
        session: of this host; its tokens end with it.
        token: the connection's ``host_token``.
    """

    def __init__(self, session: zenoh.Session, token: str) -> None:
        self._token = token
        self._zid = str(session.zid())
        self._live = session.liveliness()
        self._changes = [
            self._live.declare_subscriber(key, zenoh.handlers.RingChannel(256), history=True)
            for key in (token, f"{token}/claim/*", f"{token}/owner/*")
        ]
        self._others: set[str] = set()
        self._held: list[zenoh.LivelinessToken] = []
        self._lock = threading.Lock()

    @property
    def owned(self) -> bool:
        """Whether this host owns the robot, as of the last check."""
        return bool(self._held)

    def take(self, given_up: Callable[[], bool] = lambda: False) -> bool:
        """Try to take the lease; return whether this host owns it. Takes `SETTLE_S` if it does not own it
        yet.

        Args:
            given_up: looked at meanwhile; nobody wants to own the robot any more when it says so.
        """
        if self.owned:
            return True
        claim = self._live.declare_token(self._key("claim"))
        try:
            if not self._settle(given_up) or self._outranked():
                return False
            with self._lock:
                self._held = [self._live.declare_token(key) for key in (self._key("owner"), self._token)]
            return True
        finally:
            claim.undeclare()

    def lost(self) -> str:
        """Describe another owner to whom this host yields; empty without one."""
        if not self.owned:
            return f"another host holds {self._token}"
        others = self._look()
        rivals = [key for key in others if key.startswith(f"{self._token}/owner/")]
        return f"another host owns {self._token} too" if min(rivals, default="~") < self._key("owner") else ""

    def release(self) -> None:
        """Release the lease; the robot and all other hosts are notified."""
        with self._lock:
            held, self._held = self._held, []
        for token in reversed(held):
            token.undeclare()

    def _settle(self, given_up: Callable[[], bool]) -> bool:
        """Look for `SETTLE_S` without being kept from it; return whether anybody still wants to."""
        looked_s = time.monotonic()
        settled_s = looked_s + SETTLE_S
        while (now_s := time.monotonic()) < settled_s or now_s - looked_s > _LATE_S:
            if given_up():
                return False
            if now_s - looked_s > _LATE_S:
                settled_s = now_s + SETTLE_S
            looked_s = now_s
            self._look()
            time.sleep(_POLL_S)
        return True

    def _outranked(self) -> bool:
        """Return whether somebody else owns the robot, or claims it with a smaller id."""
        others = self._look()
        owned = any(key == self._token or key.startswith(f"{self._token}/owner/") for key in others)
        claims = (key for key in others if key.startswith(f"{self._token}/claim/"))
        return owned or min(claims, default="~") < self._key("claim")

    def _look(self) -> frozenset[str]:
        """Take in what came and went; return the others' tokens, and this host's share in the first."""
        with self._lock:
            mine = {self._key("claim"), self._key("owner")}
            for changes in self._changes:
                while (change := changes.try_recv()) is not None:
                    key = str(change.key_expr)
                    if change.kind == zenoh.SampleKind.DELETE:
                        self._others.discard(key)
                    elif key not in mine and len(self._others) < _MOST_OTHERS:
                        self._others.add(key)
            return frozenset(self._others)

    def _key(self, kind: str) -> str:
        return f"{self._token}/{kind}/{self._zid}"
