"""A simulator in a thread of the test's own process."""

from __future__ import annotations

import threading

from adatracker_deploy.platform import Sitl
from adatracker_deploy.sim.process import FaultCommands


class SitlInAThread(Sitl):
    """Keeps a simulator's thread; a subclass starts it with `serve`."""

    def __init__(self, profile):
        self._profile = profile
        self._ended = threading.Event()
        self._thread = None
        self._orders = FaultCommands()

    def serve(self, simulator, *arguments):
        """Run a simulator in the thread: `arguments`, then the event that ends it."""
        self._thread = threading.Thread(target=simulator.serve, args=(*arguments, self._ended))
        self._thread.start()

    def order(self, line):
        self._orders.handle(line)

    def close(self):
        self._ended.set()
        if self._thread is not None:
            self._thread.join()
