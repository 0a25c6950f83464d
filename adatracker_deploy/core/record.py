"""One tick of a trial, as it is logged and scored."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import Box, Twist

Outcome = Literal[
    "completed", "lost", "wrong_person", "collision", "safety_stop", "takeover", "system_fault", "interrupted"
]
"""The ways in which a trial can end; all but the first are failures."""
BY_POLICY, BY_HAND = "policy", "hand"
"""The driver of a tick: the policy, or the operator by hand (docs/teleop.md)."""
RESULTS: tuple[Outcome, ...] = ("completed", "lost", "wrong_person", "collision")
"""Outcomes that are results of a trial, not failures of the run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Latency:
    """The breakdown of one tick's time, ms of the run's clock."""

    observation_age_ms: float
    """From the frame's capture to the start of the tick."""
    infer_ms: float
    """The policy's time; 0 when the observation was too old to act on."""
    sensor_to_command_ms: float
    """From the frame's capture to the set-point handed to the link."""
    lateness_ms: float
    """Delay of the tick's start after its deadline."""
    capture_ms: float | None = None
    """From the frame's capture until perception had it: its decoding, and its waiting to be looked for."""
    perceive_ms: float | None = None
    """Time for segmentation and the target lock."""
    gate_ms: float | None = None
    """From the set-point handed to the link until its gate had judged it. Absent, with the next two, when the
    link had not sent this tick's set-point by the tick after the next, or never did."""
    send_ms: float | None = None
    """Time in which the robot's adapter sent it."""
    sensor_to_wire_ms: float | None = None
    """From the frame's capture until the set-point was sent."""
    answer_age_ms: float | None = None
    """From the capture of the picture that the action answers to the start of the tick. It and the next three
    are of policies on another machine alone, and of the answer that the tick acted on."""
    queue_ms: float | None = None
    """Time for which that picture's observation waited here, while an earlier answer was awaited."""
    round_trip_ms: float | None = None
    """From sending it until its answer was there."""
    server_ms: float | None = None
    """Inference time by the server's report; the rest of the round trip is the network's."""

    @property
    def wait_ms(self) -> float | None:
        """Time for which the observation waited for a tick to begin."""
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
    """Start of the tick, ns of the run's clock."""
    frame_seq: int
    """The camera frame that this tick acted on."""
    box: Box | None = None
    """The target's box, in fractions of the image; absent while the target is lost, and while stale."""
    stale: bool = False
    """The newest observation was too old to act on, or the policy's answer to it: the policy asked for zero.
    Neither seen nor lost."""
    others_share: float | None = None
    """The share of the image that other people cover, as `covered` counts those whom it cuts off, 0 to 1;
    absent while stale, and in older logs."""
    confidence: float
    """Perception's confidence in the target, 0 to 1."""
    action: tuple[float, ...]
    """The policy's output, in [-1, 1] or in the units of its contract; empty in a stale tick. While the hand
    drives it is recorded, and not obeyed."""
    context: tuple[float, ...]
    """The embodiment context z; empty without an encoder."""
    searching: bool = False
    """The policy drives, and turns round to look for the target; always false in older logs."""
    command: Twist
    """The velocity that the driver asked for: the policy, or the hand."""
    driver: str | None = None
    """The driver, `BY_POLICY` or `BY_HAND`; absent in logs from before anybody could drive by hand."""
    hand: tuple[float, ...] = ()
    """The hand's demand, as shares of the limits in [-1, 1]: forward, left, up, counter-clockwise. Empty
    while the policy drives, and while nobody holds the dead-man button: zero was asked for."""
    sent: Twist | None = None
    """The link's last velocity for this command, after its gate; zero once a stop has latched. Absent when a
    newer command replaced it before the link's slot, or the trial ended before the link had answered."""
    gate: tuple[str, ...] = ()
    """The reasons for the difference, by the names of `gate.Reason`; empty without one, or without `sent`."""
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
    """The breakdown of this tick's time."""
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
    """State of the target: tracked, coasting, reacquired, lost or choosing; absent without a target lock."""
    picks: int | None = None
    """Number of the operator's clicks that have changed the target so far; absent where there was none."""

    @property
    def frame_t_ns(self) -> int:
        """Capture time of this tick's frame, ns of the run's clock: exact up to an age of 26 days."""
        return self.t_ns - round(self.latency.observation_age_ms * 1e6)


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoredStep:
    """As much of a tick as scoring needs; the fields are `StepRecord`'s."""

    step: int
    t_ns: int
    box: Box | None = None
    stale: bool = False
    driver: str | None = None
    pose: Pose | None = None
    latency: Latency
    missed_deadlines: int
    distance_m: float | None = None
    bearing_rad: float | None = None
    sight: str | None = None
    mask_iou: float | None = None
    true_box: Box | None = None
    picks: int | None = None
