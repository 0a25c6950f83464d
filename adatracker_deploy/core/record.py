"""One tick of a trial, as it is logged and scored."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Box, Twist

Outcome = Literal[
    "completed", "lost", "wrong_person", "collision", "safety_stop", "takeover", "system_fault", "interrupted"
]
"""How a trial ended; all but the first are failures."""
RESULTS: tuple[Outcome, ...] = ("completed", "lost", "wrong_person", "collision")
"""Outcomes that are results of a trial, not failures of the run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Latency:
    """Where one tick's time went, ms of the run's clock."""

    observation_age_ms: float
    """From the frame's capture to the start of the tick."""
    infer_ms: float
    """What the policy took; 0 when the observation was too old to act on."""
    sensor_to_command_ms: float
    """From the frame's capture to the set-point handed to the link."""
    lateness_ms: float
    """How late the tick began against its deadline."""
    capture_ms: float | None = None
    """From the frame's capture until perception had it: its decoding, and its waiting to be looked for."""
    perceive_ms: float | None = None
    """What segmentation and the target lock took."""
    gate_ms: float | None = None
    """From the set-point handed to the link until its gate had judged it. Absent, with the next two, when the
    link had not sent this tick's set-point by the tick after the next, or never did."""
    send_ms: float | None = None
    """What the robot's adapter took to send it."""
    sensor_to_wire_ms: float | None = None
    """From the frame's capture until the set-point was sent."""
    answer_age_ms: float | None = None
    """From the capture of the picture that the action answers to the start of the tick. It and the next three
    are of policies on another machine alone, and of the answer that the tick acted on."""
    queue_ms: float | None = None
    """How long that picture's observation waited here to be sent: an earlier answer was awaited."""
    round_trip_ms: float | None = None
    """From sending it until its answer was there."""
    server_ms: float | None = None
    """What inference took, as the server says; the rest of the round trip is the network's."""

    @property
    def wait_ms(self) -> float | None:
        """How long the observation waited for a tick to begin."""
        if self.capture_ms is None or self.perceive_ms is None:
            return None
        return self.observation_age_ms - self.capture_ms - self.perceive_ms


@dataclass(frozen=True, slots=True, kw_only=True)
class StepRecord:
    """One tick: what was measured and seen as it began, what was decided, and what the link made of that.

    Lengths in m, angles in rad. In format 1 `sent`, `gate` and the latencies behind the gate were those of
    the tick before, and a stale tick had only an empty action; readers put such logs right.
    """

    step: int
    """From 0: the first tick, whose box is the reference."""
    t_ns: int
    """When the tick began, ns of the run's clock."""
    frame_seq: int
    """The camera frame that this tick acted on."""
    box: Box | None = None
    """The target's box, in fractions of the image; absent while the target is lost, and while stale."""
    stale: bool = False
    """The newest observation was too old to act on, or the policy's answer to it: zero was asked for. Neither
    seen nor lost."""
    confidence: float
    """Perception's confidence in the target, 0 to 1."""
    action: tuple[float, ...]
    """What the policy answered, in [-1, 1] or in the units of its contract; empty in a stale tick."""
    context: tuple[float, ...]
    """The embodiment context z; empty without an encoder."""
    command: Twist
    """What the policy asked for."""
    sent: Twist | None = None
    """What the link last made of this command, after its gate; zero once a stop has latched. Absent when a
    newer command replaced it before the link's slot, or the trial ended before the link had answered."""
    gate: tuple[str, ...] = ()
    """Why that is not the command, by the names of `gate.Reason`; empty when it is, or `sent` is absent."""
    mode: str
    """The robot's own name for its mode."""
    pose: Pose | None = None
    """In the robot's local fixed frame, by its own telemetry."""
    velocity: Twist | None = None
    """Measured, in the body frame."""
    battery: float | None = None
    """State of charge, 0 to 1."""
    state_age_s: float
    """Age of the robot's newest telemetry; infinite before the first."""
    latency: Latency
    """Where this tick's time went."""
    missed_deadlines: int
    """Slots skipped so far."""
    distance_m: float | None = None
    """Truth, in simulation only: horizontal distance to the target."""
    bearing_rad: float | None = None
    """Truth, in simulation only: bearing of the target, positive to the left."""
    target_visible: bool | None = None
    """Truth, in simulation only: within 90 degrees and 7.5 m, and in the mask."""
    sight: str | None = None
    """Truth, in simulation only: whether the target was seen, and if not, why; a `sight.Verdict`."""
    mask_iou: float | None = None
    """Truth, in simulation only: of the target's seen mask with the true one, 0 to 1."""
    true_box: Box | None = None
    """Truth, in simulation only: the box of the target's visible part; absent while there is none."""
    target: str | None = None
    """What is known of the target: tracked, coasting, reacquired or lost; absent where no lock keeps it."""

    @property
    def frame_t_ns(self) -> int:
        """When this tick's frame was captured, ns of the run's clock: exact up to an age of 26 days."""
        return self.t_ns - round(self.latency.observation_age_ms * 1e6)


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoredStep:
    """As much of a tick as scoring needs; the fields are `StepRecord`'s."""

    step: int
    t_ns: int
    box: Box | None = None
    stale: bool = False
    latency: Latency
    missed_deadlines: int
    distance_m: float | None = None
    bearing_rad: float | None = None
    sight: str | None = None
    mask_iou: float | None = None
    true_box: Box | None = None
