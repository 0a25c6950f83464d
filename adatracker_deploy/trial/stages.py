"""Where the time from the sensor to the wire went, stage by stage, as percentiles over a trial. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from adatracker_deploy.trial.record import Latency

Percentiles = dict[str, float | None]
"""`p50`, `p99` and `max`, ms; None where nothing was measured."""

STAGES = {
    "capture": "the picture, until perception has it",
    "perceive": "segmentation and target lock",
    "wait": "for the loop's next slot",
    "infer": "the policy",
    "gate": "the link's next slot, and the gate",
    "send": "the robot's adapter",
    "sensor_to_wire": "all of it, from capture to sent",
}
"""What each stage is, in the order of the way; names are the fields of `Latency` without their unit."""


def percentiles(values_ms: Iterable[float | None]) -> Percentiles:
    """Return the median, the 99th percentile and the maximum of what was measured."""
    known = [value for value in values_ms if value is not None]
    if not known:
        return {"p50": None, "p99": None, "max": None}
    p50, p99, highest = np.percentile(known, (50, 99, 100))
    return {"p50": float(p50), "p99": float(p99), "max": float(highest)}


def stage_times(latencies: Sequence[Latency]) -> dict[str, Percentiles]:
    """Return the percentiles of every stage; logs from before a stage was measured have None there."""
    return {stage: percentiles(getattr(latency, f"{stage}_ms") for latency in latencies) for stage in STAGES}
