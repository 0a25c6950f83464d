"""Ownership: this host is the only one that publishes commands, as the graph tells.

A ROS 2 topic has no owner: the robot obeys every publisher of commands. So another publisher on the topic is
somebody else who drives, or is about to.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_ros2.adapter.graph import name_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_ros2.protocol.participant import Participant

_LOOK_S = 0.025


class Ownership:
    """Looks for other publishers on the command topic, in the participant's thread.

    Args:
        participant: this host's; not yet started.
        topic: of the commands.
        on_rival: called at each look at which somebody else publishes.
    """

    def __init__(self, participant: Participant, topic: str, on_rival: Callable[[], None]) -> None:
        self._participant = participant
        self._topic = topic
        self._on_rival = on_rival
        self._there = False
        self._latest = ""
        participant.every(_LOOK_S, self._look)

    def rival(self) -> str:
        """Describe who else publishes commands; empty if nobody does."""
        return self._latest if self._there else ""

    def latest(self) -> str:
        """Describe who else published them last, by the node's name as soon as it is known."""
        return self._latest

    def _look(self) -> None:
        there = self._participant.node.get_publishers_info_by_topic(self._topic)
        others = [endpoint for endpoint in there if endpoint.node_name != self._participant.name]
        if others:
            names = sorted({name_of(endpoint) for endpoint in others})
            self._latest = f"{', '.join(names)} publishes to {self._topic} too"
        self._there = bool(others)  # after its description
        if others:
            self._on_rival()
