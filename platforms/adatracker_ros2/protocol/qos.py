"""Quality of service: the profile's settings as rclpy's, and which offers fit which requests."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

if TYPE_CHECKING:
    from adatracker_ros2.protocol.connection import Qos

_RELIABILITY = {"reliable": ReliabilityPolicy.RELIABLE, "best_effort": ReliabilityPolicy.BEST_EFFORT}
_DURABILITY = {
    "volatile": DurabilityPolicy.VOLATILE,
    "transient_local": DurabilityPolicy.TRANSIENT_LOCAL,
}


def ros_qos(qos: Qos) -> QoSProfile:
    """Return rclpy's profile; it keeps the last `depth` messages, so that no writer waits for a reader."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=qos.depth,
        reliability=_RELIABILITY[qos.reliability],
        durability=_DURABILITY[qos.durability],
    )


def misfit(offered: QoSProfile, requested: QoSProfile) -> str:
    """Describe why a publisher's offer does not meet a subscription's request; empty where it does.

    The two rules of DDS (OMG DDS 1.4, 2.2.3) that profiles set here; deadlines and liveliness are not
    requested on this side.
    """
    if (
        requested.reliability == ReliabilityPolicy.RELIABLE
        and offered.reliability == ReliabilityPolicy.BEST_EFFORT
    ):
        return "is published best effort, but asked for reliable"
    if (
        requested.durability == DurabilityPolicy.TRANSIENT_LOCAL
        and offered.durability == DurabilityPolicy.VOLATILE
    ):
        return "is published volatile, but asked for transient local"
    return ""
