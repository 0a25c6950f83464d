"""A topic's endpoints in ROS 2's graph, and the reasons why none of them fits. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from adatracker_ros2.protocol.qos import misfit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rclpy.qos import QoSProfile

UNNAMED = "_NODE_NAME_UNKNOWN_"
"""The graph's name for an endpoint of a program without ROS, or of a node that has just appeared."""

NAMELESS = "a program without a node name"


class Endpoint(Protocol):
    """A publisher or subscription, as rclpy's ``TopicEndpointInfo`` tells it."""

    @property
    def node_name(self) -> str: ...  # noqa: D102 -- as in rclpy

    @property
    def node_namespace(self) -> str: ...  # noqa: D102

    @property
    def topic_type(self) -> str: ...  # noqa: D102

    @property
    def qos_profile(self) -> QoSProfile: ...  # noqa: D102


def name_of(endpoint: Endpoint) -> str:
    """Return the full name of an endpoint's node."""
    if endpoint.node_name == UNNAMED:
        return NAMELESS
    return f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"


def wrong_publishers(topic: str, type_name: str, requested: QoSProfile, endpoints: Sequence[Endpoint]) -> str:
    """Return why none of a topic's publishers can be heard; empty if one can, or if there are none."""
    faults = [
        _wrong_type(topic, type_name, endpoint)
        or _wrong_qos(topic, endpoint, endpoint.qos_profile, requested)
        for endpoint in endpoints
    ]
    return faults[0] if faults and all(faults) else ""


def wrong_subscriptions(
    topic: str, type_name: str, offered: QoSProfile, endpoints: Sequence[Endpoint]
) -> str:
    """Return why none of a topic's subscriptions can be reached; empty if one can, or if there are none."""
    faults = [
        _wrong_type(topic, type_name, endpoint) or _wrong_qos(topic, endpoint, offered, endpoint.qos_profile)
        for endpoint in endpoints
    ]
    return faults[0] if faults and all(faults) else ""


def _wrong_type(topic: str, type_name: str, endpoint: Endpoint) -> str:
    if endpoint.topic_type == type_name:
        return ""
    return f"{topic} is {endpoint.topic_type} at {name_of(endpoint)}, but {type_name} in the profile"


def _wrong_qos(topic: str, endpoint: Endpoint, offered: QoSProfile, requested: QoSProfile) -> str:
    why = misfit(offered, requested)
    return f"{topic} {why} (the other side is {name_of(endpoint)})" if why else ""
