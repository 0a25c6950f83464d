"""The hardware abstraction: what a robot is to this toolkit.

A robot is an ordinary Python package that registers one `Platform` subclass under the entry-point group
``adatracker_deploy.platforms``; `registry` finds it.
"""

from __future__ import annotations

import abc
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

from adatracker_deploy.config.effects import NONE, Effects
from adatracker_deploy.config.schema import Range
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.faults import Fault
from adatracker_deploy.core.geometry import Pose

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType

    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.camera import Camera
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.messages import PlatformState, Twist


@dataclass(frozen=True, slots=True)
class Check:
    """The result of one preflight check; a failed blocking check refuses to engage."""

    name: str
    ok: bool
    message: str
    """The finding and, when not ok, the remedy."""
    blocking: bool = True
    fix: str = ""
    """Shell commands that mend it, one a line; empty where it is mended otherwise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraMount:
    """The mount of a simulated camera; part of a profile's ``sitl:`` section, never seen by a policy."""

    forward_m: Annotated[float, Range(-2, 2)] = 0.0
    up_m: Annotated[float, Range(-1, 4)] = 0.0
    """Height above the body's origin: for a ground robot the camera's height, for a drone its offset."""
    pitch_deg: Annotated[float, Range(-90, 90)] = 0.0
    """Positive looks down."""
    fov_deg: Annotated[float, Range(20, 150)] = 90.0
    """Horizontal field of view."""

    def pose(self, body: Pose) -> Pose:
        """Return the camera's pose when the body is at `body`."""
        return body @ Pose(x=self.forward_m, z=self.up_m, pitch=math.radians(self.pitch_deg))


class Body(abc.ABC):
    """A robot's dynamics: a velocity command and a time step in, a pose out. Deterministic given a seed."""

    @abc.abstractmethod
    def reset(self, pose: Pose, seed: int) -> None:
        """Stand still at `pose` (a flying body: hover there); draw this episode's randomness from `seed`."""

    @abc.abstractmethod
    def step(self, command: Twist, dt_s: float) -> None:
        """Advance by `dt_s` seconds under a velocity command in the body frame."""

    @property
    @abc.abstractmethod
    def pose(self) -> Pose:
        """Return the pose of the body's origin in the fixed frame; for ground robots it is on the ground."""

    @property
    @abc.abstractmethod
    def camera_pose(self) -> Pose:
        """Return the camera's pose: x along the optical axis, z up in the image."""

    @property
    @abc.abstractmethod
    def velocity(self) -> Twist:
        """Return the current velocity in the body frame."""


_FASTEST_PERSON_M_S = 5.0
_MOST_OTHERS = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """The world of a rehearsal; a simulator with its own camera places its robot in it."""

    scene: str = "simple_room"
    target_speed_m_s: float = 1.0
    seed: int = 0
    """Seeds the world and everything random in the simulated robot."""
    others: int = 0
    """People who walk about besides the target, 0 to 20."""
    person: str = ""
    """The target's glTF file; empty for one of those that ship."""
    width_px: int = 640
    """Width of its pictures, 64 to 1920; they are 4 to 3."""
    effects: Effects = NONE
    """Fog, a rough road, people who sit down."""

    def __post_init__(self) -> None:
        if not 0 <= self.target_speed_m_s <= _FASTEST_PERSON_M_S:  # false for NaN too
            raise UsageError(
                f"target speed {self.target_speed_m_s:g} m/s: expected 0 to {_FASTEST_PERSON_M_S:g}"
            )
        if not 0 <= self.others <= _MOST_OTHERS:
            raise UsageError(f"{self.others} other people: expected 0 to {_MOST_OTHERS}")
        if not 64 <= self.width_px <= 1920:
            raise UsageError(f"pictures of {self.width_px} px: expected 64 to 1920")

    @property
    def picture_size(self) -> tuple[int, int]:
        """Return the pictures' width and height, px."""
        return self.width_px, self.width_px * 3 // 4


class Sitl(abc.ABC):
    """A robot's simulator, in its own process, behind the robot's real protocol."""

    faults: tuple[Fault, ...] = ()
    """The faults that `order` can inject."""
    witness: Path | None = None
    """The file to which the ground-truth recorder already writes; None before that was ordered."""

    @abc.abstractmethod
    def start(self, clock: Clock, scenario: Scenario) -> Profile:
        """Start the simulator; return the profile with its connection, and its camera if it has one.

        Raises:
            UsageError: a port is taken or an extra is missing.
            PlatformError: the simulator did not come up.
        """

    @abc.abstractmethod
    def close(self) -> None:
        """Stop the simulator after its robot has come to rest (a drone lands). May be called twice."""

    def order(self, line: str) -> None:  # noqa: B027 -- for those whose simulator can be made to fail
        """Send a command to the simulator: ``begin`` or ``end`` one of `faults`, ``witness FILE``."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class Platform(abc.ABC):
    """A robot, reached over its real protocol.

    ``connect -> preflight -> engage -> send ... -> hold -> disengage -> close``. `hold`, `disengage` and
    `close` may be called at any time, repeatedly, from any state and from any thread. Known failures raise
    `PlatformError`. A stop latches: after `hold`, a fault or an unexpected mode change, nothing moves until
    an explicit `engage`.
    """

    name: ClassVar[str]
    """The name for ``--platform``."""
    axes: ClassVar[frozenset[str]]
    """The fields of `Twist` that this robot can follow."""
    Connection: ClassVar[type[Any]]
    """Frozen dataclass of the profile's ``connection:`` section."""
    SitlSettings: ClassVar[type[Any]]
    """Frozen dataclass of the profile's ``sitl:`` section."""
    default_profile: ClassVar[str]
    """The profile used when ``--profile`` is not given."""
    profile_dir: ClassVar[Path | None] = None
    """The folder in the robot's own package that holds its profiles; None when the toolkit ships them."""

    traffic_formats: ClassVar[tuple[str, ...]] = ()
    """Formats of `export_traffic`, by suffix such as ``.asc``; empty when `record` writes nothing."""

    def __init__(self, profile: Profile, clock: Clock) -> None:
        self.profile = profile
        self.clock = clock

    @abc.abstractmethod
    def connect(self) -> None:
        """Open the connection and wait for a first message from the robot; moves nothing."""

    @abc.abstractmethod
    def preflight(self) -> tuple[Check, ...]:
        """Check what must hold before engaging, above all the robot's own command time-out."""

    @abc.abstractmethod
    def engage(self) -> None:
        """Return once velocity commands are accepted: a base is enabled, a drone flies offboard."""

    @abc.abstractmethod
    def send(self, command: Twist, now_ns: int) -> Twist:
        """Send one velocity command, made at `now_ns`; return what was really sent.

        Raises:
            PlatformError: the command is not finite (nothing is sent), or the robot is not engaged.
        """

    @abc.abstractmethod
    def state(self) -> PlatformState:
        """Return the newest state, which carries its own age; never blocks."""

    def notices(self) -> tuple[str, ...]:
        """Return new notices for the operator since the last call; never blocks.

        Each becomes a warning in the trial's log, so adapters keep them few, whatever arrives.
        """
        return ()

    def record(self, folder: Path) -> None:  # noqa: B027 -- for those that keep their wire's traffic
        """Write the wire's own traffic into a trial's folder until `close`; never blocks, never raises.

        The link calls it between `connect` and `engage`. A file that cannot be written is a notice.
        """

    @classmethod
    def export_traffic(cls, folder: Path, out: Path, ahead_ns: int) -> None:
        """Write what `record` left in a trial's folder as one of `traffic_formats`.

        Args:
            folder: of the trial.
            out: the file to write; its suffix is one of `traffic_formats`.
            ahead_ns: by what wall-clock time is ahead of the run's clock, ns.

        Raises:
            UsageError: the trial has none, or a file cannot be read or written.
        """
        raise NotImplementedError(f"{cls.name} has no traffic formats")

    @abc.abstractmethod
    def hold(self, reason: str) -> None:
        """Stop moving; latches."""

    @abc.abstractmethod
    def disengage(self) -> None:
        """Give up control in the robot's safe way: a base is disabled, a drone lands and disarms.

        Returns when done. A robot that somebody else has taken over is left to them.
        """

    @abc.abstractmethod
    def close(self) -> None:
        """Close the connection."""

    @classmethod
    def identity(cls, profile: Profile) -> str:  # noqa: ARG003 -- for those that say
        """Name the robot that a profile reaches: the same for every profile that reaches it from here.

        Empty where the robot's package does not say.
        """
        return ""

    @classmethod
    def camera(cls, profile: Profile, clock: Clock) -> Camera:  # noqa: ARG003 -- for those that have one
        """Return the robot's own camera for a ``robot://`` URI; not open yet.

        It is read in another process than the adapter's, so it shares nothing with it.

        Raises:
            UsageError: the robot has no camera.
        """
        raise UsageError(
            f"camera {profile.camera.uri}: {cls.name} carries no camera on its own wire; "
            "give a device, a file or an address with --camera"
        )

    @classmethod
    @abc.abstractmethod
    def body(cls, profile: Profile) -> Body:
        """Return the robot's dynamics, as the profile's ``sitl:`` section describes them."""

    @classmethod
    @abc.abstractmethod
    def sitl(cls, profile: Profile) -> Sitl:
        """Return the simulator that ``--sitl`` uses in place of the robot."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
