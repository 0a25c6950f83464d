"""The latency from sensor to robot by stage, as percentiles over a trial. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from adatracker_deploy.scoring.stats.running import RunningQuantiles

if TYPE_CHECKING:
    from collections.abc import Iterable

    from adatracker_deploy.core.record import Latency

Percentiles = dict[str, float | None]
"""`p50`, `p99` and `max`, ms; None where nothing was measured."""

STAGES = {
    "capture": "the picture, until perception has it",
    "perceive": "segmentation and target lock",
    "wait": "until the tick begins",
    "infer": "the policy",
    "gate": "the link's next slot, and the gate",
    "send": "the robot's adapter",
    "sensor_to_wire": "all of it, from capture to sent",
}
"""The stages from camera to wire, in order; names are the fields of `Latency` without their unit."""

FAR_STAGES = {
    "queue": "until the observation is sent",
    "round_trip": "until the server's answer is there",
    "server": "of that, inference, as the server says",
    "answer_age": "age of the picture that is acted on, as the tick begins",
}
"""Likewise, of policies on another machine."""


class LatencyPercentiles:
    """The percentiles of some fields of `Latency`, by their names without the unit, as ticks come.

    Exact in a short trial, within 0.1 % in a long one (`RunningQuantiles`). Logs from before a stage was
    measured have None there.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._known = {name: RunningQuantiles() for name in names}

    def add(self, latency: Latency) -> None:
        """Take the next tick's."""
        for name, values_ms in self._known.items():
            if (value_ms := getattr(latency, f"{name}_ms")) is not None:
                values_ms.add(value_ms)

    def found(self) -> dict[str, Percentiles]:
        """Return them as they are so far."""
        return {name: _percentiles(values_ms) for name, values_ms in self._known.items()}


def _percentiles(values_ms: RunningQuantiles) -> Percentiles:
    p50, p99, highest = values_ms.quantiles((0.5, 0.99, 1.0)) or (None, None, None)
    return {"p50": p50, "p99": p99, "max": highest}
