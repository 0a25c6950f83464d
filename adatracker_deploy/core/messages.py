"""Messages that flow through the loop: frame, observation, action, command, state.

They are frozen, and their arrays are never written to. Times are nanoseconds of the run's clock (monotonic,
scaled in a rehearsal at ``--speed``), never wall-clock time.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.geometry import Pose

if TYPE_CHECKING:
    from adatracker_deploy.core.sight import Sight

ClassMask = NDArray[np.uint8]
"""Shape (H, W); values are `MaskClass`."""


class MaskClass(enum.IntEnum):
    """The class that a pixel of a class mask shows."""

    BACKGROUND = 0
    TARGET = 1
    PERSON = 2
    OBSTACLE = 3


def at_size(mask: ClassMask, height: int, width: int) -> ClassMask:
    """Return a mask's nearest pixels at another size, shape (height, width)."""
    if mask.shape == (height, width):
        return mask
    rows, columns = (
        ((np.arange(wanted) + 0.5) * given / wanted).astype(np.intp)
        for wanted, given in zip((height, width), mask.shape, strict=True)
    )
    return np.asarray(mask[rows[:, None], columns])


FILLED_M2 = 0.19
"""Share of the image that one person covers, times their squared distance: 0.12 at 1.25 m before a 90 degree
lens. With a narrower lens people seem nearer than they are."""
_BREADTH_M = 0.245
"""Breadth of one person in widths of the image, times their distance: 0.49 m before a 90 degree lens."""
_RIM = 1 / 50
"""Share of the image's height, above and below, that masks of whom it cuts off may leave free."""


def covered(mask: ClassMask) -> float:
    """Return the share of the image that people other than the target cover, 0 to 1.

    Who is cut off above or below, as near people are, covers less than their distance says. They count by
    their breadth instead, where that is more: as much as somebody so broad would cover whole.
    """
    people = mask == MaskClass.PERSON
    share = float(people.mean())
    rim = math.ceil(mask.shape[0] * _RIM)
    cut_off = people[:rim].any(axis=0) | people[-rim:].any(axis=0)
    if not cut_off.any():
        return share
    # whoever stands in columns side by side is one
    edges = np.flatnonzero(np.diff(people.any(axis=0), prepend=False, append=False))
    broadest = max(right - left for left, right in edges.reshape(-1, 2) if cut_off[left:right].any())
    return min(max(share, _so_broad(float(broadest) / mask.shape[1])), 1.0)


def _so_broad(width: float) -> float:
    """Return the share of the image that a person covers whole whose width is this share of the image's."""
    return FILLED_M2 * (width / _BREADTH_M) ** 2


Contact = Literal["an obstacle", "the target", "another person", "something"]
"""What a robot may touch in a simulated world."""


@dataclass(frozen=True, slots=True)
class Truth:
    """Ground truth, known only to a simulated camera; policies never see it."""

    mask: ClassMask
    robot: Pose
    camera: Pose
    target_xy: tuple[float, float]
    distance_m: float
    """Horizontal distance from the robot to the target, m."""
    bearing_rad: float
    """Bearing of the target from the robot's heading, rad, positive to the left."""
    contact: Contact | None = None
    """What the robot touches in this frame; `something` where the world does not tell."""
    in_view: bool = True
    """The target is in the picture, or would be if nothing hid it."""


class Click(NamedTuple):
    """An operator's wish that the person at a point of a picture be the target."""

    number: int
    """From 1, of one page."""
    seq: int
    """The frame that the operator saw; 0 for the newest."""
    x: float
    """From the left, in fractions of the image."""
    y: float
    """From the top."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One camera image: RGB uint8 of shape (H, W, 3), its capture time and sequence number."""

    rgb: NDArray[np.uint8]
    t_ns: int
    seq: int
    truth: Truth | None = None
    jpeg: bytes | None = None
    """The JPEG that `rgb` was decoded from, if any; the log reuses it."""
    click: Click | None = None
    """The operator's wish, given with the first frame after it."""


@dataclass(frozen=True, slots=True)
class Shot:
    """A picture as a simulated camera sends it: JPEG, with its capture time, sequence number and truth."""

    jpeg: bytes
    t_ns: int
    seq: int
    truth: Truth


@dataclass(frozen=True, slots=True)
class Box:
    """A bounding box in fractions of the image: centre (cx, cy) from the top left, width and height."""

    cx: float
    cy: float
    w: float
    h: float

    @property
    def area(self) -> float:
        """Return the share of the image that the box covers."""
        return self.w * self.h

    @property
    def covered(self) -> float:
        """Return the share of the image that the person in the box covers, 0 to 1, as `covered` counts."""
        cut_off = self.cy - self.h / 2 < _RIM or self.cy + self.h / 2 > 1.0 - _RIM
        return min(max(self.area, _so_broad(self.w)), 1.0) if cut_off else self.area

    def iou(self, other: Box) -> float:
        """Return the intersection over union of two boxes, 0 to 1."""
        across = min(self.cx + self.w / 2, other.cx + other.w / 2) - max(
            self.cx - self.w / 2, other.cx - other.w / 2
        )
        down = min(self.cy + self.h / 2, other.cy + other.h / 2) - max(
            self.cy - self.h / 2, other.cy - other.h / 2
        )
        shared = max(0.0, across) * max(0.0, down)
        either = self.area + other.area - shared
        return min(1.0, shared / either) if either > 0 else 0.0

    @classmethod
    def of_mask(cls, mask: ClassMask, value: int = MaskClass.TARGET) -> Box | None:
        """Return the tight box around the pixels equal to `value`, or None when there are none."""
        hit = mask == value
        columns = np.flatnonzero(hit.any(axis=0))
        if columns.size == 0:
            return None
        rows = np.flatnonzero(hit.any(axis=1))
        height, width = mask.shape
        left, right = columns[0] / width, (columns[-1] + 1) / width
        top, bottom = rows[0] / height, (rows[-1] + 1) / height
        return cls(float(left + right) / 2, float(top + bottom) / 2, float(right - left), float(bottom - top))


class TargetState(enum.Enum):
    """The target's tracking state in one frame."""

    TRACKED = "tracked"
    COASTING = "coasting"
    """Briefly out of sight; at first with a box where it is expected."""
    REACQUIRED = "reacquired"
    """Seen again in this frame, after having been lost."""
    LOST = "lost"
    CHOOSING = "choosing"
    """The operator has chosen somebody who has not been seen since."""


class Pick(NamedTuple):
    """The operator's last click, and who was there."""

    click: Click
    box: Box | None
    """The person's box in the frame that was clicked; None: nobody was there, and nothing changed."""
    taken: int
    """Number of clicks that have changed the target so far; one on the target does not."""


@dataclass(frozen=True, slots=True)
class Observation:
    """Perception's result for one frame; `t_ns` and `seq` are the frame's."""

    mask: ClassMask
    box: Box | None
    """The target's box, or None while it is not seen."""
    confidence: float
    t_ns: int
    seq: int
    target: TargetState | None = None
    """None before a target is chosen, and in rehearsals, where the target is known."""
    image: NDArray[np.uint8] | None = None
    """The frame's picture, RGB of shape (H, W, 3); filled in by the loop, for policies that look at it."""
    state: PlatformState | None = None
    """The robot's last report, likewise."""
    pick: Pick | None = None
    """None before any click, and from segmenters whose target cannot be chosen."""

    @property
    def others_share(self) -> float:
        """The share of the image that other people cover, 0 to 1; see `covered`."""
        return covered(self.mask)


@dataclass(frozen=True, slots=True)
class Action:
    """A policy's output: `values`, float32, with the order, signs and units of its `ActionSpec`."""

    values: NDArray[np.float32]
    context: NDArray[np.float32] | None = None
    """The embodiment context z of shape (n,), where the policy has an encoder."""
    answer: Answer | None = None
    """The action's way from another machine; None for policies in this process."""
    searching: bool = False
    """The policy turns round to look for a target that has left the view, as a rule says."""


@dataclass(frozen=True, slots=True)
class Answer:
    """An action's way through another machine; ms of the machine's time."""

    t_ns: int
    """Capture time of the picture that it answers, ns of the run's clock."""
    queue_ms: float
    """Time for which the observation waited here before it was sent."""
    round_trip_ms: float
    """From sending the observation until the answer was there."""
    server_ms: float | None
    """Inference time by the server's report."""


@dataclass(frozen=True, slots=True)
class Twist:
    """A velocity in the body frame of ROS REP 103: x forward, y left, z up, yaw counter-clockwise."""

    vx: float = 0.0
    """Forward, m/s."""
    vy: float = 0.0
    """Left, m/s."""
    vz: float = 0.0
    """Up, m/s."""
    yaw_rate: float = 0.0
    """Counter-clockwise seen from above, rad/s."""

    def is_finite(self) -> bool:
        """Return whether no component is NaN or infinite."""
        return all(map(math.isfinite, (self.vx, self.vy, self.vz, self.yaw_rate)))


ZERO = Twist()

LONGEST_REASON = 95
"""Largest length of `PlatformState.stopped`, characters."""


@dataclass(frozen=True, slots=True)
class PlatformState:
    """The robot's state from its own telemetry; missing values are None, never guessed."""

    t_ns: int
    """Clock time of the newest measurement, ns; 0 before the first."""
    mode: str = ""
    """The robot's own name for its mode, at most 23 ASCII characters."""
    engaged: bool = False
    """Velocity commands are accepted and obeyed."""
    landed: bool = True
    """On the ground (always true for ground robots)."""
    pose: Pose | None = None
    """In the robot's local fixed frame: x east or start-forward, y left of it, z up above the start."""
    velocity: Twist | None = None
    """Measured, in the body frame."""
    battery: float | None = None
    """State of charge, 0 to 1."""
    stopped: str = ""
    """Reason for a latched stop; empty while there is none. At most `LONGEST_REASON` characters."""
    taken_over: bool = False
    """The stop came from elsewhere: the pilot's sticks, a remote control, the robot's own fail-safe."""

    def age_s(self, now_ns: int) -> float:
        """Return the seconds since the newest measurement; infinite before the first."""
        return (now_ns - self.t_ns) / 1e9 if self.t_ns else math.inf


class Seen(NamedTuple):
    """An observation and the frame it was made from."""

    frame: Frame
    observation: Observation
    taken_ns: int | None = None
    """Time at which perception received the frame, by the run's clock; None when segmenting without one."""
    ready_ns: int | None = None
    """Time at which the observation was made, likewise."""
    spacing_ns: int | None = None
    """From the previous observation's frame to this one's, by the times at which they were taken."""
    sight: Sight | None = None
    """Comparison with the truth, where that is known."""
