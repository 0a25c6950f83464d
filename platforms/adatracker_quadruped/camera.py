"""The robot's own camera: sensor_msgs/CompressedImage over Zenoh, the newest image alone.

It has a session of its own, for it lives in the tracker's process. A rehearsal's robot says by a token that
it is one; then, and only then, each image is paired with the truth of the same stamp.
"""

from __future__ import annotations

import atexit
import threading
from collections import deque
from typing import TYPE_CHECKING

import zenoh

from adatracker_deploy.errors import PlatformError
from adatracker_deploy.perception.image import decode_image
from adatracker_deploy.perception.live import LiveCamera, Picture
from adatracker_quadruped.camera_topic import with_camera
from adatracker_quadruped.keys import Keys
from adatracker_quadruped.messages import decode_compressed_image
from adatracker_quadruped.protocol import IMAGE_CAP_BYTES
from adatracker_quadruped.session import open_session
from adatracker_quadruped.sitl_keys import TRUTH_CAP_BYTES, SitlKeys, stamp_of, truth_of
from adatracker_quadruped.watch import fresh

if TYPE_CHECKING:
    from collections.abc import Generator

    from adatracker_deploy.messages import Frame, Truth
    from adatracker_deploy.profile import Profile
    from adatracker_deploy.runtime.clock import Clock

_TOKEN_TIMEOUT_S = 1.0
_TRUTHS_KEPT = 8
"""The truth of an image is put before it, so that only images which are skipped leave theirs behind."""


class ZenohCamera(LiveCamera):
    """Reads the topic after ``robot://``; a frame's time is that of its reception.

    The robot's clock and this machine's need not agree, so the time on the way is not known; on one machine
    it is below a millisecond for a JPEG of 40 kB.
    """

    def __init__(self, profile: Profile, clock: Clock) -> None:
        self._connection = with_camera(profile)
        self._key = Keys(self._connection).camera
        super().__init__(f"robot://{self._key}", clock)
        self._sitl_keys = SitlKeys(self._connection)
        self._decode = fresh(decode_compressed_image)
        self._session: zenoh.Session | None = None
        self._using = threading.Lock()
        """Held by whoever uses the session: Zenoh's raises a RuntimeError when it is closed meanwhile."""
        self._rehearses = False
        self.dropped = 0
        """Messages that were malformed, too large, repeated or without their truth."""

    def read(self, now_ns: int) -> Frame | None:
        """Return the newest frame that had arrived at `now_ns`.

        Raises:
            PlatformError: the robot does not answer any more, or its camera is silent or frozen.
        """
        with self._using:
            gone = self._session is not None and not any(_neighbours(self._session))
        if gone:
            endpoint = self._connection.endpoint
            raise PlatformError(f"camera {self.name}: nobody answers at {endpoint} any more")
        return super().read(now_ns)

    def go(self) -> None:
        """Let the people of a rehearsal walk; a real robot is not told."""
        with self._using:
            if self._session is not None and self._rehearses:
                self._session.put(self._sitl_keys.go, b"")

    def _pictures(self) -> Generator[Picture, None, None]:
        session = open_session(self._connection)
        atexit.register(self.close)  # an interpreter that ends under a waiting reader aborts
        try:
            with self._using:
                self._session = session
                self._rehearses = _has_token(session, self._sitl_keys.alive)
                truths = _Truths(session, self._sitl_keys.truth) if self._rehearses else None
                images = session.declare_subscriber(self._key, zenoh.handlers.RingChannel(1))
            while not self._ending.is_set():
                try:
                    sample = images.recv()
                except zenoh.ZError:  # `_interrupt` has closed the session
                    return
                t_ns = self.clock.now_ns()
                try:
                    picture = self._picture(sample, t_ns, truths)
                except ValueError:
                    self.dropped += 1
                    continue
                yield picture
        finally:
            self._interrupt()

    def _interrupt(self) -> None:
        atexit.unregister(self.close)
        with self._using:
            session, self._session = self._session, None
            if session is not None:
                session.close()

    def _picture(self, sample: zenoh.Sample, t_ns: int, truths: _Truths | None) -> Picture:
        if len(sample.payload) > IMAGE_CAP_BYTES:
            raise ValueError(f"a message of {len(sample.payload)} bytes")
        image = self._decode(bytes(sample.payload))
        truth = truths.of(image.stamp_ns) if truths is not None else None
        return Picture(decode_image(bytes(image.data)), t_ns, truth)


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


def _neighbours(session: zenoh.Session) -> list[zenoh.ZenohId]:
    """Return whom the session is connected to."""
    return [*session.info.routers_zid(), *session.info.peers_zid()]
