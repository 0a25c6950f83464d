"""A viewer as Foxglove is one: a plain websocket client that shares no code with the live view.

It speaks the published protocol: JSON texts for what is offered and asked, and for messages binary frames of
an opcode (1), the subscription's number, the time in ns and the data, little-endian.
"""

from __future__ import annotations

import base64
import json
import socket
import struct
from dataclasses import dataclass

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from websockets.sync.client import connect

SUBPROTOCOL = "foxglove.sdk.v1"
MESSAGE = 1
WAIT_S = 10.0


@dataclass(frozen=True)
class Told:
    """A message as it came, and what it says."""

    topic: str
    time_ns: int
    data: bytes
    says: object


class Viewer:
    """A client that is subscribed to `topics`, by default to all, once it is made.

    That a subscription is in force is nowhere said; but requests are answered in turn, and what was told in
    between is thrown away with the answer.

    Args:
        port: of the live view.
        receive_bytes: what the kernel may hold for it, unless it is to decide.
    """

    def __init__(self, port: int, topics=None, receive_bytes: int | None = None) -> None:
        self.socket = socket.socket()
        if receive_bytes is not None:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_bytes)
        self.socket.settimeout(WAIT_S)
        self.socket.connect(("127.0.0.1", port))
        self._connecting = connect(
            f"ws://127.0.0.1:{port}",
            sock=self.socket,
            subprotocols=[SUBPROTOCOL],
            max_size=None,
            max_queue=1,
            ping_interval=None,  # one that does not read would hang up on itself
            close_timeout=0.1,
        )
        self.websocket = self._connecting.__enter__()
        self.info = self.ask()
        self.channels = self.ask()["channels"]
        self._kinds = {}
        wanted = [channel for channel in self.channels if topics is None or channel["topic"] in topics]
        for number, channel in enumerate(wanted):
            self._kinds[number] = channel["topic"], decoder(channel)
        self.send(
            op="subscribe",
            subscriptions=[
                {"id": number, "channelId": channel["id"]} for number, channel in enumerate(wanted)
            ],
        )
        self.ask(op="getParameters", parameterNames=[], id="subscribed")  # refused, after what it follows

    def send(self, **request) -> None:
        self.websocket.send(json.dumps(request))

    def ask(self, **request) -> dict:
        """Send a request, if there is one; return the next text."""
        if request:
            self.send(**request)
        while isinstance(answer := self.websocket.recv(timeout=WAIT_S), bytes):
            pass
        return json.loads(answer)

    def next(self, timeout_s: float = WAIT_S) -> Told:
        """Return the next message.

        Raises:
            TimeoutError: none came.
        """
        while isinstance(frame := self.websocket.recv(timeout=timeout_s), str):
            pass
        opcode, number, time_ns = struct.unpack_from("<BIQ", frame)
        assert opcode == MESSAGE
        topic, decode = self._kinds[number]
        data = frame[13:]
        return Told(topic, time_ns, data, decode(data))

    def until(self, condition) -> list[Told]:
        """Return messages up to the first that meets `condition`."""
        told = [self.next()]
        while not condition(told[-1]):
            told.append(self.next())
        return told

    def close(self) -> None:
        self._connecting.__exit__(None, None, None)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def decoder(channel):
    """Return what decodes a channel's messages, by the schema that the channel itself brings."""
    if channel["encoding"] == "json":
        return json.loads
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"])).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"])).FromString
