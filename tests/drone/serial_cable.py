"""A serial cable between a simulated autopilot, which speaks UDP, and whoever opens the other end."""

import contextlib
import os
import pty
import select
import socket
import threading
import tty


class SerialCable:
    """A pty pair: `device` is the companion's serial port; its other side is the UDP port `port`."""

    def __init__(self):
        self._near, self._far = pty.openpty()
        for end in (self._near, self._far):
            tty.setraw(end)
        os.set_blocking(self._near, False)
        self.device = os.ttyname(self._far)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self.port = self._socket.getsockname()[1]
        self.carried = {"to the companion": 0, "to the autopilot": 0}
        """Bytes."""
        self._cut = threading.Event()
        self._thread = threading.Thread(target=self._carry)
        self._thread.start()

    def _carry(self):
        autopilot = None
        while not self._cut.is_set():
            ready, _, _ = select.select([self._socket, self._near], [], [], 0.05)
            if self._socket in ready:
                data, autopilot = self._socket.recvfrom(65535)
                with contextlib.suppress(BlockingIOError):  # nobody reads: lost, as on a wire
                    self.carried["to the companion"] += os.write(self._near, data)
            if self._near in ready and (data := os.read(self._near, 4096)) and autopilot is not None:
                self.carried["to the autopilot"] += self._socket.sendto(data, autopilot)

    def pull(self):
        """Carry nothing more, either way; the port itself stays."""
        self._cut.set()
        self._thread.join()

    def close(self):
        self.pull()
        self._socket.close()
        os.close(self._near)
        os.close(self._far)
