"""Publisher of one topic, with its dialect's attachment."""

from __future__ import annotations

import uuid

import zenoh

from adatracker_quadruped.protocol.keys import attachment


class Publisher:
    """Publishes CDR on one key; samples are dropped rather than queued, and a put never waits for a reader.

    With queueing, a reader that was frozen for 3 s was measured to be sent the commands of all that time in
    one burst.
    """

    def __init__(self, session: zenoh.Session, key: str, *, attaches: bool) -> None:
        self.key = key
        self._publisher = session.declare_publisher(
            key,
            encoding=zenoh.Encoding.APPLICATION_CDR,
            express=True,
            priority=zenoh.Priority.REAL_TIME,
            congestion_control=zenoh.CongestionControl.DROP,
        )
        self._attaches = attaches
        self._gid = uuid.uuid4().bytes
        self._sequence = 0

    @property
    def matched(self) -> bool:
        """Return whether somebody subscribes; nothing else would say that nobody does."""
        return bool(self._publisher.matching_status.matching)

    def put(self, payload: bytes, stamp_ns: int) -> None:
        """Send one message; `stamp_ns` is since 1970."""
        self._sequence += 1
        attached = attachment(self._sequence, stamp_ns, self._gid) if self._attaches else None
        self._publisher.put(payload, attachment=attached)
