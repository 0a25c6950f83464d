"""Where the time from the sensor to the wire went, stage by stage, as percentiles over a trial. Pure."""

from __future__ import annotations

from array import array
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

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


def latency_percentiles(latencies: Iterable[Latency], names: Iterable[str]) -> dict[str, Percentiles]:
    """Return the percentiles of some fields of `Latency`, by their names without the unit.

    Logs from before a stage was measured have None there. Ticks are looked at once and not kept: a trial may
    be hours long.
    """
    known = {name: array("d") for name in names}
    for latency in latencies:
        for name, values_ms in known.items():
            if (value_ms := getattr(latency, f"{name}_ms")) is not None:
                values_ms.append(value_ms)
    return {name: _percentiles(values_ms) for name, values_ms in known.items()}


def _percentiles(values_ms: array[float]) -> Percentiles:
    if not values_ms:
        return {"p50": None, "p99": None, "max": None}
    p50, p99, highest = np.percentile(values_ms, (50, 99, 100))
    return {"p50": float(p50), "p99": float(p99), "max": float(highest)}
