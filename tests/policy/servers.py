"""Policy servers on real sockets: the shipped one, and others that answer as they like."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import threading

import numpy as np

from adatracker_deploy.core.messages import Box, Observation
from adatracker_deploy.policy.msgpack_numpy import pack, unpack
from adatracker_deploy.policy.remote import RemotePolicy

MANIFEST = {
    "name": "far",
    "rate_hz": 10.0,
    "action": [{"axis": "forward"}, {"axis": "yaw", "sign": -1}],
    "observation": ["mask", "box", "confidence", "image", "state", "prompt"],
}
PERIOD_NS = 100_000_000


@contextlib.contextmanager
def running(server):
    """Give its address; at the end it is shut down, and whoever is connected is told."""
    scheme = "wss" if "SSL" in type(server.socket).__name__ else "ws"
    with server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield "{}://{}:{}".format(scheme, *server.socket.getsockname()[:2])
        server.shutdown()
        thread.join(10)


class Saying:
    """Answers of somebody else's server, and the requests of a loop that it has received.

    Args:
        answers: of (message, number) gives what is sent: a dict, text or bytes, a list of those, None for
            nothing. What is asked before the start is answered with zeros, and not counted.
        manifest: its contract; None for none.
        repeats: answers say which request they answer, as far as they are dicts and do not say it already.
    """

    def __init__(self, answers, manifest=MANIFEST, *, repeats=True):
        self.answers, self.manifest, self.repeats, self.heard = answers, manifest, repeats, []

    def __call__(self, connection):
        from websockets.exceptions import ConnectionClosed

        connection.send(pack({"adatracker": self.manifest} if self.manifest is not None else {}))
        with contextlib.suppress(ConnectionClosed):
            for data in connection:
                message = unpack(data)
                if message["request"] < 0:
                    said = {"actions": np.zeros(len(self.manifest["action"]))}
                else:
                    self.heard.append(message)
                    said = self.answers(message, len(self.heard) - 1)
                for each in said if isinstance(said, list) else [said]:
                    self._send(connection, each, message)

    def _send(self, connection, said, message):
        if isinstance(said, dict) and self.repeats:
            said = {"request": message["request"]} | said
        if said is not None:
            connection.send(said if isinstance(said, str | bytes) else pack(said))


@contextlib.contextmanager
def saying(answers, manifest=MANIFEST, *, repeats=True):
    """Run such a server; give its address and the messages that it has heard."""
    from websockets.sync.server import serve

    server = Saying(answers, manifest, repeats=repeats)
    with running(serve(server, "127.0.0.1", 0, compression=None, max_size=None, close_timeout=1)) as uri:
        yield uri, server.heard


@contextlib.contextmanager
def asking(uri, **how):
    """A policy at that address, closed at the end."""
    with contextlib.closing(RemotePolicy(uri, **how)) as remote:
        yield remote


@contextlib.contextmanager
def serving(policy="pid"):
    """The command in a process of its own; give it and its address."""
    command = [sys.executable, "-m", "adatracker_deploy", "serve", "--policy", policy, "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        yield process, process.stdout.readline().strip()
    finally:
        process.kill()
        process.communicate()


def seen(seq, t_ns=None):
    """An observation of noise, the same for the same number."""
    rng = np.random.default_rng(seq)
    mask = rng.integers(0, 4, (48, 64)).astype(np.uint8)
    box = Box(*rng.uniform(0.2, 0.5, 4).tolist())
    image = rng.integers(0, 255, (8, 6, 3)).astype(np.uint8)
    return Observation(mask, box, 0.5, seq * PERIOD_NS if t_ns is None else t_ns, seq, image=image)
