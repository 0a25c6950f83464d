"""Camera that receives ROS 2 compressed images over Zenoh; keeps only the newest.

Imported only when somebody asks for such a camera, for it needs eclipse-zenoh.
"""

from __future__ import annotations

import atexit
import threading
from typing import TYPE_CHECKING

import zenoh

from adatracker_deploy.core.errors import PlatformError
from adatracker_deploy.perception.compressed_image import IMAGE_CAP_BYTES, read_compressed_image
from adatracker_deploy.perception.image import decode_image, is_png
from adatracker_deploy.perception.live import LiveCamera, Picture
from adatracker_deploy.perception.zenoh_graph import Graph
from adatracker_deploy.perception.zenoh_session import dial

if TYPE_CHECKING:
    from collections.abc import Generator

    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.messages import Frame, Truth


class CompressedImageCamera(LiveCamera):
    """Subscribes to one key in its own session; on one machine a 40 kB JPEG takes less than 1 ms.

    Args:
        name: how errors name the camera.
        clock: the run's.
        endpoint: the router's or bridge's, such as ``tcp/192.168.1.20:7447``.
        key: the topic's key expression.
    """

    def __init__(self, name: str, clock: Clock, *, endpoint: str, key: str) -> None:
        super().__init__(name, clock)
        self._endpoint = endpoint
        self._key = key
        self._session: zenoh.Session | None = None
        self._using = threading.Lock()
        """Held while the session is in use: Zenoh's raises a RuntimeError when it is closed meanwhile."""

    def read(self, now_ns: int) -> Frame | None:
        """Return the newest frame that had arrived by `now_ns`.

        Raises:
            PlatformError: the robot no longer answers, or its camera is silent or frozen.
        """
        with self._using:
            gone = self._session is not None and not any(_neighbours(self._session))
        if gone:
            raise PlatformError(f"camera {self.name}: nothing answers at {self._endpoint} any more")
        return super().read(now_ns)

    def _dial(self) -> zenoh.Session:
        """Open the session."""
        return dial(self._endpoint)

    def _begin(self, session: zenoh.Session) -> None:
        """Hook for subclasses, called before the first image."""

    def _truth(self, stamp_ns: int) -> Truth | None:  # noqa: ARG002 -- a real robot's images have none
        """Return the truth of the image with this stamp.

        Raises:
            ValueError: it should have come and has not.
        """
        return None

    def _pictures(self) -> Generator[Picture, None, None]:
        session = self._dial()
        atexit.register(self.close)  # an interpreter that ends under a waiting reader aborts
        try:
            with self._using:
                self._session = session
                self._begin(session)
                images = session.declare_subscriber(self._key, zenoh.handlers.RingChannel(1))
                graph = Graph(session)
                graph.subscribes(self._key)
            while not self._ending.is_set():
                try:
                    sample = images.recv()
                    picture = self._picture(sample, self.clock.now_ns())
                except zenoh.ZError:  # `_interrupt` has closed the session
                    return
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

    def _picture(self, sample: zenoh.Sample, t_ns: int) -> Picture:
        if len(sample.payload) > IMAGE_CAP_BYTES:
            raise ValueError(f"a message of {len(sample.payload)} bytes")
        image = read_compressed_image(bytes(sample.payload))
        truth = self._truth(image.stamp_ns)
        data = bytes(image.data)
        return Picture(decode_image(data), t_ns, image.stamp_ns, truth, None if is_png(data) else data)


def _neighbours(session: zenoh.Session) -> list[zenoh.ZenohId]:
    """Return whom the session is connected to."""
    return [*session.info.routers_zid(), *session.info.peers_zid()]
