"""One tick of a trial, as it is logged and scored."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from adatracker_deploy.geometry import Pose
from adatracker_deploy.messages import Box
from adatracker_deploy.platform import Twist

Outcome = Literal[
    "completed", "lost", "wrong_person", "collision", "safety_stop", "takeover", "system_fault", "interrupted"
]
"""How a trial ended; all but the first are failures."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Latency:
    """Where one tick's time went, ms of the run's clock."""

    observation_age_ms: float
    """From the frame's capture to the start of the tick."""
    infer_ms: float
    sensor_to_command_ms: float
    """From the frame's capture to the set-point handed to the link."""
    lateness_ms: float
    """How late the tick began against its deadline."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StepRecord:
    """One tick: what was seen, decided, sent and measured; lengths in m, angles in rad."""

    step: int
    """From 0: the first tick, whose box is the reference."""
    t_ns: int
    frame_seq: int
    box: Box | None
    confidence: float
    action: tuple[float, ...]
    context: tuple[float, ...]
    """The embodiment context z; empty without an encoder."""
    command: Twist
    """What the policy asked for."""
    sent: Twist
    """What the link last sent, after its gate."""
    gate: tuple[str, ...]
    """Why the gate changed the command; empty when it did not."""
    mode: str
    pose: Pose | None
    velocity: Twist | None
    battery: float | None
    state_age_s: float
    latency: Latency
    missed_deadlines: int
    """Slots skipped so far."""
    distance_m: float | None = None
    """Truth, in simulation only."""
    bearing_rad: float | None = None
    """Truth, in simulation only."""
    target_visible: bool | None = None
    """Truth, in simulation only: within 90 degrees and 7.5 m, and in the mask."""
