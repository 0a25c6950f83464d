"""Receiver: the base's telemetry, and whether it may be driven on. Pure; time is an argument."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from adatracker_wheeled.adapter.odometry import LONGEST_STEP_S, DeadReckoning
from adatracker_wheeled.protocol.frames import Malformed

if TYPE_CHECKING:
    from adatracker_deploy.core.geometry import Pose
    from adatracker_deploy.core.messages import Twist
    from adatracker_wheeled.protocol.codec import Codec
    from adatracker_wheeled.protocol.frames import BaseStatus, CanFrame
    from adatracker_wheeled.protocol.roles import Roles, Timing

_REST_M_S, _REST_RAD_S = 0.05, 0.1
"""Measured motion below both is rest."""
_MOST_IDS = 64
"""Number of unknown ids to remember, to explain why a base is not understood."""
_V1_STATE, _V2_STATE = 0x151, 0x211
"""The state frames of AgileX's two protocols."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseTelemetry:
    """The newest telemetry; times are the run's clock at receipt, ns, 0 before the first message."""

    status: BaseStatus | None = None
    status_t_ns: int = 0
    """Time of the last new state; if the base counts its states, a repeated one is not new."""
    motion: Twist | None = None
    motion_t_ns: int = 0
    pose: Pose | None = None
    """By dead reckoning, from where the base stood when it was first heard."""
    pose_t_ns: int = 0
    battery: float | None = None
    battery_t_ns: int = 0
    rival_id: int | None = None
    """Id of the newest frame with which another host commands the base."""
    rival_t_ns: int = 0

    @property
    def at_rest(self) -> bool:
        """Whether measured motion shows the base at rest."""
        motion = self.motion
        return motion is not None and abs(motion.vx) < _REST_M_S and abs(motion.yaw_rate) < _REST_RAD_S


class Receiver:
    """Turns frames into a snapshot, from one thread; others only read `heard`.

    Args:
        codec: of the base.
        roles: the same that the codec reads.
        speed: the run's clock's seconds per second of the machine's.
    """

    def __init__(self, codec: Codec, roles: Roles, speed: float = 1.0) -> None:
        self.heard = BaseTelemetry()
        self.malformed = 0
        """Number of malformed frames of the base; they changed nothing."""
        self.unknown_ids: set[int] = set()
        """Ids that no role names, the first few."""
        self._codec = codec
        self._by_wheels = bool(roles.odometry) and roles.wheels is not None
        self._reckoning = DeadReckoning(
            track_m=roles.wheels.track_m if roles.wheels else None,
            wrap_m=codec.wheel_wrap_m,
            longest_step_s=LONGEST_STEP_S * speed,
        )

    def forget(self) -> None:
        """Start again after a lost bus; the pose is kept."""
        self.heard = BaseTelemetry(pose=self.heard.pose)

    def receive(self, frame: CanFrame, now_ns: int) -> None:
        """Take in one frame, received at `now_ns`; none of them is this side's own."""
        if self._codec.is_command(frame):
            self.heard = replace(self.heard, rival_id=frame.id, rival_t_ns=now_ns)
            return
        try:
            reading = self._codec.parse(frame)
        except Malformed:
            self.malformed += 1
            return
        if reading is None:
            if len(self.unknown_ids) < _MOST_IDS:
                self.unknown_ids.add(frame.id)
            return
        heard = self.heard
        if reading.status is not None and not _repeated(heard.status, reading.status):
            heard = replace(heard, status=reading.status, status_t_ns=now_ns)
        if reading.motion is not None:
            heard = replace(heard, motion=reading.motion, motion_t_ns=now_ns)
            if not self._by_wheels:
                self._reckoning = self._reckoning.moved(reading.motion, now_ns)
                heard = replace(heard, pose=self._reckoning.pose, pose_t_ns=now_ns)
        if reading.wheels_m is not None and self._by_wheels:
            self._reckoning = self._reckoning.rolled(reading.wheels_m, now_ns)
            heard = replace(heard, pose=self._reckoning.pose, pose_t_ns=now_ns)
        if reading.battery is not None:
            heard = replace(heard, battery=reading.battery, battery_t_ns=now_ns)
        self.heard = heard

    def explain_silence(self) -> str:
        """Explain why the base's state may not be received."""
        if _V1_STATE in self.unknown_ids:
            return "it speaks AgileX protocol v1 (0x151 on the bus): use a v1 profile, such as scout_v1"
        if _V2_STATE in self.unknown_ids:
            return "it speaks AgileX protocol v2 (0x211 on the bus): use its v2 profile, such as scout"
        if self.malformed:
            return f"{self.malformed} of its frames were malformed: check roles.dbc and roles.checksum"
        if self.unknown_ids:
            ids = ", ".join(f"{number:#x}" for number in sorted(self.unknown_ids)[:6])
            return f"only frames without a role came ({ids}): check roles against the base's manual"
        return "no frame came at all: switch the base on, check cable, termination and bit rate"


def _repeated(before: BaseStatus | None, now: BaseStatus) -> bool:
    return before is not None and now.count is not None and before.count == now.count


@dataclass(frozen=True, slots=True)
class StopCause:
    """A reason for which the base must not be driven on."""

    reason: str
    taken: bool = False
    """Somebody else has taken over the base: it is left to them."""
    by_hand: bool = False
    """Somebody at the robot wanted it: with the remote control or the emergency stop."""


def rival(heard: BaseTelemetry, since_ns: int) -> StopCause | None:
    """Return the stop cause if another host has commanded the base after `since_ns`."""
    if heard.rival_id is None or heard.rival_t_ns <= since_ns:
        return None
    why = f"somebody else on the bus commands the base (frames {heard.rival_id:#x}): end that program first"
    return StopCause(why, taken=True, by_hand=True)


def unfit(status: BaseStatus) -> StopCause | None:
    """Return the faults in the base's own report that forbid driving in any mode."""
    if status.mode == "remote":
        return StopCause("the base is under remote control", taken=True, by_hand=True)
    if status.emergency_stop:
        return StopCause("the base's emergency stop is pressed", by_hand=True)
    if status.fault:
        return StopCause(f"the base reports: {status.fault}")
    return None


def trouble(heard: BaseTelemetry, timing: Timing, now_ns: int, speed: float) -> StopCause | None:
    """Judge at `now_ns` whether a base that is driven may be driven on; ages are in machine time.

    Args:
        heard: of the base.
        timing: the profile's.
        now_ns: the run's clock.
        speed: its seconds per second of the machine's.
    """
    status = heard.status
    state_age_s = (now_ns - heard.status_t_ns) / 1e9 / speed
    if status is None or state_age_s > timing.state_timeout_s:
        return StopCause(f"no new state from the base for {state_age_s:.2f} s")
    if found := unfit(status):
        return found
    if status.mode != "ours":
        why = f"the base went to {status.mode_name} by itself or by somebody else's command"
        return StopCause(why, taken=True, by_hand=True)
    motion_age_s = (now_ns - heard.motion_t_ns) / 1e9 / speed
    if motion_age_s > timing.feedback_timeout_s:
        return StopCause(f"no measured motion from the base for {motion_age_s:.2f} s")
    return None
