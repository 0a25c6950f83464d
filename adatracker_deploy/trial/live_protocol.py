"""Messages of the live view's websocket: Foxglove's protocol, as far as a server that only shows needs it.

Texts are JSON objects whose `op` says what they are; messages are binary: an opcode, the subscription's
number, the time and the data, little-endian. https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md
"""

from __future__ import annotations

import base64
import json
import struct
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from adatracker_deploy.trial.channels import Channel

SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
"""Names of the protocol, the newer first; what is used of it is the same in both."""
_MESSAGE = struct.Struct("<BIQ")
_MESSAGE_OPCODE = 1
_CALL = struct.Struct("<BII")
_CALL_OPCODE = 2
_ERROR = 2
_LONGEST_QUOTE = 40


def server_info(name: str, session: str) -> str:
    """Return the first text: who serves, and that it can do nothing but show."""
    return json.dumps(
        {"op": "serverInfo", "name": name, "capabilities": [], "metadata": {}, "sessionId": session}
    )


def advertise(channels: Mapping[int, Channel]) -> str:
    """Return the text that offers channels, by their numbers."""
    return json.dumps(
        {
            "op": "advertise",
            "channels": [
                {
                    "id": number,
                    "topic": channel.topic,
                    "encoding": channel.encoding,
                    "schemaName": channel.schema_name,
                    "schemaEncoding": channel.schema_encoding,
                    "schema": _schema_text(channel),
                }
                for number, channel in channels.items()
            ],
        }
    )


def message_frame(subscription: int, time_ns: int, data: bytes) -> bytes:
    """Return one message as it is sent; `time_ns` is wall-clock time."""
    return _MESSAGE.pack(_MESSAGE_OPCODE, subscription, time_ns) + data


class Subscriptions:
    """The topics that one client has subscribed to, and the answers to its requests.

    Args:
        topics: what can be told, by the channels' numbers.
    """

    def __init__(self, topics: Mapping[int, str]) -> None:
        self._topics = topics
        self._numbers: dict[str, int] = {}

    def number(self, topic: str) -> int | None:
        """Return the client's number for a topic; None if it is not subscribed. Any thread may ask."""
        return self._numbers.get(topic)

    def answer(self, request: bytes, *, is_text: bool) -> Iterator[str]:
        """Take a request, which obeys it, if it is to subscribe or not to; yield the texts to answer."""
        if not is_text:
            yield _binary_refused(request)
            return
        try:
            asked = json.loads(request.decode())
        except (ValueError, RecursionError):
            asked = None
        match asked:
            case {"op": "subscribe", "subscriptions": list(wanted)}:
                for each in wanted:
                    yield from self._subscribe(each)
            case {"op": "unsubscribe", "subscriptionIds": list(numbers)}:
                yield from self._unsubscribe(numbers)
            case {"op": str(operation)}:
                yield _status(f"{_quoted(operation)} is refused or incomplete: this server only shows")
            case _:
                yield _status("not understood: no JSON object with an 'op'")

    def _subscribe(self, wanted: Any) -> Iterator[str]:
        match wanted:
            case {"id": int(number), "channelId": int(channel)} if _is_uint32(number):
                topic = self._topics.get(channel)
                if topic is None:
                    yield _status(f"there is no channel {_quoted(channel)}")
                elif topic in self._numbers or number in self._numbers.values():
                    yield _status(f"channel {channel} or subscription {number} is taken")
                else:
                    self._numbers[topic] = number
            case _:
                yield _status("a subscription needs an 'id' and a 'channelId'")

    def _unsubscribe(self, numbers: Sequence[Any]) -> Iterator[str]:
        for number in numbers:
            topics = [topic for topic, known in self._numbers.items() if known == number]
            if not topics:
                yield _status(f"there is no subscription {_quoted(number)}")
            for topic in topics:
                del self._numbers[topic]


def _schema_text(channel: Channel) -> str:
    if channel.schema_encoding == "protobuf":
        return base64.b64encode(channel.schema).decode()
    return channel.schema.decode()


def _binary_refused(request: bytes) -> str:
    if len(request) >= _CALL.size and request[0] == _CALL_OPCODE:
        _, service, call = _CALL.unpack_from(request)
        refused = {"op": "serviceCallFailure", "serviceId": service, "callId": call}
        return json.dumps(refused | {"message": "there are no services: this server only shows"})
    return _status("binary messages are refused: this server only shows")


def _status(text: str) -> str:
    return json.dumps({"op": "status", "level": _ERROR, "message": text})


def _is_uint32(number: int) -> bool:
    return not isinstance(number, bool) and 0 <= number < 1 << 32


def _quoted(value: Any) -> str:
    return ascii(value)[:_LONGEST_QUOTE]
