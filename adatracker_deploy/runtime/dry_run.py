"""Stands in for the robot in a dry run: nothing is connected, and nothing can move."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from adatracker_deploy.core.errors import PlatformError, UsageError
from adatracker_deploy.core.messages import ZERO, PlatformState, Twist
from adatracker_deploy.platform import Body, Check, Platform, Sitl

if TYPE_CHECKING:
    from adatracker_deploy.config.profile import Profile
    from adatracker_deploy.core.clock import Clock


class DryRun(Platform):
    """Accepts commands without carrying them out, and latches stops; works with any robot's profile."""

    name = "dry-run"
    axes = frozenset({"vx", "vy", "vz", "yaw_rate"})
    Connection: ClassVar[type[Any]] = object
    SitlSettings: ClassVar[type[Any]] = object
    default_profile = ""

    def __init__(self, profile: Profile, clock: Clock) -> None:
        super().__init__(profile, clock)
        self._engaged = False
        self._stopped = ""

    def connect(self) -> None:
        """Do nothing: there is no robot."""

    def preflight(self) -> tuple[Check, ...]:
        """Report that this is a dry run."""
        return (Check("dry run", ok=True, message="no robot is connected: nothing moves"),)

    def engage(self) -> None:
        """Accept commands from now on."""
        self._engaged, self._stopped = True, ""

    def send(self, command: Twist, now_ns: int) -> Twist:  # noqa: ARG002 -- nobody is there to be late for
        """Return the command, which is sent nowhere.

        Raises:
            PlatformError: the command is not finite, or a stop has latched.
        """
        if not command.is_finite():
            raise PlatformError("the command is not finite")
        if not self._engaged or self._stopped:
            raise PlatformError(f"not engaged: {self._stopped or 'engage first'}")
        return command

    def state(self) -> PlatformState:
        """Return the state of a robot at rest."""
        return PlatformState(
            t_ns=self.clock.now_ns(),
            mode="DRY RUN",
            engaged=self._engaged,
            velocity=ZERO,
            stopped=self._stopped,
        )

    def hold(self, reason: str) -> None:
        """Take no commands any more."""
        self._stopped = self._stopped or reason

    def disengage(self) -> None:
        """Take no commands any more."""
        self._engaged = False

    def close(self) -> None:
        """Do nothing: there is no connection."""

    @classmethod
    def body(cls, profile: Profile) -> Body:
        """Refuse: nothing moves."""
        raise UsageError(f"{profile.name}: a dry run has no body")

    @classmethod
    def sitl(cls, profile: Profile) -> Sitl:
        """Refuse: nothing is simulated."""
        raise UsageError(f"{profile.name}: a dry run has no simulator")
