"""The robot's own camera: sensor_msgs/CompressedImage over Zenoh; keeps only the newest image.

It has its own session, because it runs in the tracker's process. A simulated robot identifies itself by a
token; only then is each image paired with the ground truth of the same stamp.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import zenoh

from adatracker_deploy.config.camera_topic import with_camera
from adatracker_deploy.perception.zenoh_camera import CompressedImageCamera
from adatracker_quadruped.protocol.keys import Keys
from adatracker_quadruped.protocol.rehearsal_keys import TRUTH_CAP_BYTES, SitlKeys, stamp_of, truth_of
from adatracker_quadruped.protocol.session import open_session

if TYPE_CHECKING:
    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.messages import Truth

_TOKEN_TIMEOUT_S = 1.0
_TRUTHS_KEPT = 8
"""The truth of an image is put before it, so that only images which are skipped leave theirs behind."""


class ZenohCamera(CompressedImageCamera):
    """Reads the topic after ``robot://``, as the profile's connection reaches it."""

    def __init__(self, profile: Profile, clock: Clock) -> None:
        self._connection = with_camera(profile)
        key = Keys(self._connection).camera
        super().__init__(f"robot://{key}", clock, endpoint=self._connection.endpoint, key=key)
        self._sitl_keys = SitlKeys(self._connection)
        self._truths: _Truths | None = None
        """In a rehearsal."""

    def go(self) -> None:
        """Let the people of a rehearsal walk; a real robot gets no request."""
        with self._using:
            if self._session is not None and self._truths is not None:
                self._session.put(self._sitl_keys.go, b"")

    def _dial(self) -> zenoh.Session:
        return open_session(self._connection)

    def _begin(self, session: zenoh.Session) -> None:
        # Of a rehearsal that --sitl has started nobody need ask; on a busy machine the answer may be late.
        if self._sitl_keys.run or _has_token(session, self._sitl_keys.alive):
            self._truths = _Truths(session, self._sitl_keys.truth)

    def _truth(self, stamp_ns: int) -> Truth | None:
        return self._truths.of(stamp_ns) if self._truths is not None else None


class _Truths:
    """The truths of a rehearsal that came last, by the stamps of their images."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._come = session.declare_subscriber(key, zenoh.handlers.RingChannel(_TRUTHS_KEPT))
        self._kept: deque[bytes] = deque(maxlen=_TRUTHS_KEPT)

    def of(self, stamp_ns: int) -> Truth:
        """Return the truth of the image with this stamp.

        Raises:
            ValueError: it has not come, or it is malformed.
        """
        while (sample := self._come.try_recv()) is not None:
            if len(sample.payload) <= TRUTH_CAP_BYTES:
                self._kept.append(bytes(sample.payload))
        for payload in self._kept:
            if stamp_of(payload) == stamp_ns:
                return truth_of(payload)
        raise ValueError("an image without its truth")


def _has_token(session: zenoh.Session, key: str) -> bool:
    return any(reply.ok for reply in session.liveliness().get(key, timeout=_TOKEN_TIMEOUT_S))
