"""The robot's own camera: sensor_msgs/CompressedImage over Zenoh, the newest image alone.

It has a session of its own, for it lives in the tracker's process. A rehearsal's robot says by a token that
it is one; then, and only then, each image is paired with the truth of the same stamp.
"""

from __future__ import annotations

import time
from collections import deque
from typing import TYPE_CHECKING

from adatracker_deploy.errors import PlatformError
from adatracker_deploy.messages import Frame
from adatracker_deploy.perception.camera import OPEN_TIMEOUT_S
from adatracker_quadruped.camera_topic import with_camera
from adatracker_quadruped.image import decode_rgb
from adatracker_quadruped.keys import Keys
from adatracker_quadruped.messages import CompressedImage, Malformed, decode_compressed_image
from adatracker_quadruped.protocol import IMAGE_CAP_BYTES
from adatracker_quadruped.session import open_session
from adatracker_quadruped.sitl_keys import TRUTH_CAP_BYTES, SitlKeys, StampedTruth, decode_stamped_truth
from adatracker_quadruped.tap import Tap
from adatracker_quadruped.watch import fresh

if TYPE_CHECKING:
    import zenoh

    from adatracker_deploy.messages import Truth
    from adatracker_deploy.profile import Profile
    from adatracker_deploy.runtime.clock import Clock

SILENCE_S = 2.0
"""Machine time without a new image after which the camera is gone."""
_TRUTHS_KEPT = 8
"""An image that is being decoded is at most so many behind."""
_POLL_S = 0.005


class ZenohCamera:
    """A `Camera` on the topic after ``robot://``; a frame's time is that of its reception.

    The robot's clock and this machine's need not agree, so the time on the way is not known; on one machine
    it is below a millisecond for a JPEG of 40 kB.
    """

    def __init__(self, profile: Profile, clock: Clock) -> None:
        self._connection = with_camera(profile)
        self._key = Keys(self._connection).camera
        self._sitl_keys = SitlKeys(self._connection)
        self._clock = clock
        self._session: zenoh.Session | None = None
        self._images: Tap[CompressedImage] | None = None
        self._truths: _Truths | None = None
        self._frame: Frame | None = None
        self._looked_at = 0
        """The number of the newest image that was looked into."""
        self._undecodable = 0

    def open(self) -> None:
        """Dial the robot; return once an image has come.

        Raises:
            PlatformError: nobody answers, or no image comes within `OPEN_TIMEOUT_S`.
            UsageError: a certificate's file is not there.
        """
        if self._session is not None:
            return
        self._session = open_session(self._connection)
        if any(reply.ok for reply in self._session.liveliness().get(self._sitl_keys.alive, timeout=1.0)):
            self._truths = _Truths(self._session, self._sitl_keys.truth, self._clock)
        self._images = Tap(
            self._session, self._key, fresh(decode_compressed_image), self._clock, IMAGE_CAP_BYTES
        )
        deadline_s = time.monotonic() + OPEN_TIMEOUT_S
        while self._newest(self._images, self._clock.now_ns()) is None:
            if time.monotonic() > deadline_s:
                dropped = self.dropped
                self.close()
                raise PlatformError(
                    f"no image came on {self._key} within {OPEN_TIMEOUT_S:g} s"
                    + (f" ({dropped} malformed ones did)" if dropped else "")
                    + ": start the robot's camera node, or name another topic with --camera robot://TOPIC"
                )
            time.sleep(_POLL_S)

    def read(self, now_ns: int) -> Frame | None:
        """Return the newest image that had come by `now_ns`; None before the first.

        Raises:
            PlatformError: the router is gone, or no image has come for `SILENCE_S`.
        """
        if self._session is None or self._images is None:
            raise PlatformError(f"the camera on {self._key} is not open")
        info = self._session.info
        if not info.routers_zid() and not info.peers_zid():
            raise PlatformError(f"nobody answers at {self._connection.endpoint} any more: the camera is gone")
        frame = self._newest(self._images, now_ns)
        if frame is not None:
            silent_s = (self._clock.now_ns() - frame.t_ns) / 1e9 / self._clock.speed
            if silent_s > SILENCE_S:
                raise PlatformError(f"no new image on {self._key} for {silent_s:.1f} s: the camera is gone")
        return frame

    def go(self) -> None:
        """Let the people of a rehearsal walk; a real robot's world moves by itself."""
        if self._session is not None and self._truths is not None:
            self._session.put(self._sitl_keys.go, b"")

    def close(self) -> None:
        """Close the session."""
        session, images, truths = self._session, self._images, self._truths
        self._session = self._images = self._truths = None
        if session is not None:
            session.close()
        if images is not None:
            images.join()
        if truths is not None:
            truths.tap.join()

    @property
    def dropped(self) -> int:
        """Images that were malformed, too large, repeated or undecodable."""
        return self._undecodable + (self._images.dropped if self._images else 0)

    def _newest(self, images: Tap[CompressedImage], now_ns: int) -> Frame | None:
        """Look into the newest image unless that was done before; return the newest good frame."""
        reading = images.newest
        if reading is None or reading.count == self._looked_at or reading.t_ns > now_ns:
            return self._frame
        image, truth = reading.value, None
        if self._truths is not None and (truth := self._truths.of(image.stamp_ns)) is None:
            return self._frame  # it is still on its way
        self._looked_at = reading.count
        try:
            self._frame = Frame(decode_rgb(image.data), reading.t_ns, reading.count, truth)
        except Malformed:
            self._undecodable += 1
        return self._frame


class _Truths:
    """The last truths of a rehearsal, by the stamps of their images."""

    def __init__(self, session: zenoh.Session, key: str, clock: Clock) -> None:
        self._kept: deque[StampedTruth] = deque(maxlen=_TRUTHS_KEPT)
        self.tap = Tap(session, key, self._keep, clock, TRUTH_CAP_BYTES)

    def of(self, stamp_ns: int) -> Truth | None:
        """Return the truth of the image with this stamp, or None."""
        return next((kept.truth for kept in tuple(self._kept) if kept.stamp_ns == stamp_ns), None)

    def _keep(self, payload: bytes) -> StampedTruth:
        stamped = decode_stamped_truth(payload)
        self._kept.append(stamped)
        return stamped
