"""rmw_zenoh's graph: the liveliness tokens by which ROS 2 nodes know who publishes and who subscribes.

Zenoh itself passes messages without them. But whoever asks ROS 2 for the number of subscribers, as
image_transport does before it encodes a picture, counts tokens. Their form is that of
``liveliness_utils.cpp`` in ros2/rmw_zenoh. Imported only when somebody speaks Zenoh.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import zenoh

NODE = "adatracker_deploy"
"""This program's name among the nodes."""
_KEY = re.compile(
    r"(?P<domain>\d{1,3})/(?P<name>.+)/(?P<type>[^/:]+::[^/:]+::dds_::[^/:]+_)"
    r"/(?P<type_hash>RIHS01_[0-9a-f]{64}|TypeHashNotSupported)"
)
_QOS = "2:2:1,1:,:,:,,"
"""Best effort, volatile, keep the last one, no deadline, lifespan or lease: rmw's numbers. They are written
out because the defaults that may be left out have changed with rmw_zenoh's releases."""


class Topic(NamedTuple):
    """The topic that an rmw_zenoh key describes."""

    domain: int
    name: str
    """Without a slash in front."""
    type: str
    type_hash: str


def topic_of(key: str) -> Topic | None:
    """Return the topic of a key; None if it is not one of rmw_zenoh's."""
    match = _KEY.fullmatch(key)
    return match and Topic(int(match["domain"]), match["name"], match["type"], match["type_hash"])


def node_token(domain: int, zid: str) -> str:
    """Return the token of this program as a node.

    Args:
        domain: ROS_DOMAIN_ID.
        zid: the session's.
    """
    return f"@ros2_lv/{domain}/{zid}/0/0/NN/%/%/{NODE}"


def publisher_token(topic: Topic, zid: str, number: int) -> str:
    """Return the token of a publisher; `number` is its own in the session, from 1."""
    return _token("MP", topic, zid, number)


def subscriber_token(topic: Topic, zid: str, number: int) -> str:
    """Return the token of a subscriber; `number` is its own in the session, from 1."""
    return _token("MS", topic, zid, number)


def is_ours(token: str) -> bool:
    """Return whether a token is one of this program's, in this process or another."""
    chunks = token.split("/")
    return len(chunks) > 8 and chunks[0] == "@ros2_lv" and chunks[8] == NODE


class Graph:
    """Shows a session's publishers and subscribers to ROS 2 until it is closed."""

    def __init__(self, session: zenoh.Session) -> None:
        self._live = session.liveliness()
        self._zid = str(session.zid())
        self._node: zenoh.LivelinessToken | None = None
        self._tokens: list[zenoh.LivelinessToken] = []

    def publishes(self, key: str) -> None:
        """Show that the session publishes on a key; one that is not rmw_zenoh's needs no showing."""
        if topic := topic_of(key):
            self._show(topic, publisher_token(topic, self._zid, len(self._tokens) + 1))

    def subscribes(self, key: str) -> None:
        """Show that the session subscribes to a key; likewise."""
        if topic := topic_of(key):
            self._show(topic, subscriber_token(topic, self._zid, len(self._tokens) + 1))

    def _show(self, topic: Topic, token: str) -> None:
        if self._node is None:
            self._node = self._live.declare_token(node_token(topic.domain, self._zid))
        self._tokens.append(self._live.declare_token(token))


def _token(kind: str, topic: Topic, zid: str, number: int) -> str:
    name = "%" + topic.name.replace("/", "%")
    entity = f"@ros2_lv/{topic.domain}/{zid}/0/{number}/{kind}/%/%/{NODE}"
    return f"{entity}/{name}/{topic.type}/{topic.type_hash}/{_QOS}"
