"""The operator's page of a run: served by the log's writer, which has every tick, far from the control loop.

Unlike the live view it takes requests: to follow somebody else, which it hands to the tracker, and to stop,
for which it signals the tracker as `adatracker-deploy stop` does, whatever the tracker is at.
"""

from __future__ import annotations

import dataclasses
import os
from typing import TYPE_CHECKING, Any

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

from adatracker_deploy.page.feed import Feed, Pictures
from adatracker_deploy.page.server import PageServer
from adatracker_deploy.runtime.stopping import ANSWER_S, stop

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from adatracker_deploy.core.messages import Box, Click
    from adatracker_deploy.core.record import StepRecord
    from adatracker_deploy.trial.channels import Message
    from adatracker_deploy.trial.ipc import Look, PageStart

_STAGES = {
    "capture": "capture_ms",
    "perceive": "perceive_ms",
    "wait": "wait_ms",
    "infer": "infer_ms",
    "gate": "gate_ms",
    "send": "send_ms",
    "sensor to wire": "sensor_to_wire_ms",
}


class PageView:
    """Shows one trial on its page.

    Args:
        start: what is to be served, and where.

    Raises:
        UsageError: its port is in use.
    """

    def __init__(self, start: PageStart) -> None:
        self._tracker = start.tracker_pid
        self._feed = Feed(start.about)
        self._server = PageServer(
            start.address, self._feed, option="--page", stop=self._stop, unchoosable=start.unchoosable
        )

    def look(self, look: Look, messages: Iterable[Message]) -> None:
        """Show what is seen before the first tick."""
        state = {"phase": "looking", "seq": look.seq, "target": look.target, "box": _box(look.box)}
        self._feed.show(state, self._pictures(messages))

    def step(self, record: StepRecord, messages: Iterable[Message]) -> None:
        """Show a tick."""
        self._feed.show(of_step(record), self._pictures(messages))

    def event(self, level: str, text: str) -> None:
        """Show an event."""
        self._feed.say(level, text)

    def clicks(self) -> list[Click]:
        """Return where the operator has clicked since the last call."""
        return self._server.clicks()

    def close(self) -> None:
        """End every stream and free the port."""
        self._server.close()

    def _pictures(self, messages: Iterable[Message]) -> Pictures | None:
        """Return the frame of some messages; None where there is none, or nobody looks."""
        if not self._feed.watched:
            return None
        found = {
            message.topic: bytes(CompressedImage.FromString(message.data).data)
            for message in messages
            if message.topic in {"/camera", "/mask"}
        }
        return Pictures(found.get("/camera", b""), found.get("/mask", b"")) if found else None

    def _stop(self) -> str:
        if os.getppid() != self._tracker:
            return "the run has ended"
        if stop(self._tracker):
            return "the run stops"
        return f"the run did not answer for {ANSWER_S:g} s and was killed: its link stops the robot"


def of_step(record: StepRecord) -> Mapping[str, Any]:
    """Return a tick as the page takes it: velocities in m/s and rad/s, times in ms."""
    twists = {"wish": record.command, "sent": record.sent, "measured": record.velocity}
    return {
        "phase": "following",
        "seq": record.frame_seq,
        "step": record.step,
        "target": "stale" if record.stale else record.target or ("seen" if record.box else "lost"),
        "searching": record.searching,
        "confidence": record.confidence,
        "box": _box(record.box),
        "driver": record.driver,
        **{name: dataclasses.asdict(twist) for name, twist in twists.items() if twist is not None},
        "gate": record.gate,
        "mode": record.mode,
        "battery": record.battery,
        "missed": record.missed_deadlines,
        "ms": {name: getattr(record.latency, field) for name, field in _STAGES.items()},
    }


def _box(box: Box | None) -> tuple[float, float, float, float] | None:
    return None if box is None else (box.cx, box.cy, box.w, box.h)
