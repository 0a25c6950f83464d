"""The speeds allowed now: the profile's, narrowed by the robot's state and position."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.messages import FILLED_M2, PlatformState, Twist
from adatracker_deploy.runtime.gate.braking import fastest_m_s
from adatracker_deploy.runtime.gate.place import rest_height_m
from adatracker_deploy.runtime.gate.reasons import Reason
from adatracker_deploy.runtime.gate.state import GateState, Setpoint


@dataclass(frozen=True, slots=True, kw_only=True)
class Envelope:
    """The largest speeds, each a magnitude in m/s or rad/s; zero is always inside."""

    forward: float
    backward: float
    lateral: float
    up: float
    down: float
    yaw_rate: float

    @classmethod
    def of(cls, limits: Limits) -> Envelope:
        """Return a profile's envelope."""
        return cls(
            forward=limits.forward_m_s,
            backward=limits.backward_m_s,
            lateral=limits.lateral_m_s,
            up=limits.vertical_m_s,
            down=limits.vertical_m_s,
            yaw_rate=limits.yaw_rate_rad_s,
        )

    def times(self, share: float) -> Envelope:
        """Return the envelope with every speed scaled."""
        return Envelope(
            forward=share * self.forward,
            backward=share * self.backward,
            lateral=share * self.lateral,
            up=share * self.up,
            down=share * self.down,
            yaw_rate=share * self.yaw_rate,
        )

    def clip(self, twist: Twist) -> Twist:
        """Return the nearest velocity inside the envelope."""
        return Twist(
            vx=min(max(twist.vx, -self.backward), self.forward),
            vy=min(max(twist.vy, -self.lateral), self.lateral),
            vz=min(max(twist.vz, -self.down), self.up),
            yaw_rate=min(max(twist.yaw_rate, -self.yaw_rate), self.yaw_rate),
        )


def ramped(limits: Limits, state: GateState, now_ns: int) -> float:
    """Return the share of the envelope open at this time after the first motion, 0 to 1."""
    if Reason.RAMP in limits.switched_off:
        return 1.0
    if state.moving_ns is None:
        return 0.0
    return min((now_ns - state.moving_ns) / 1e9 / limits.ramp_s, 1.0)


def nearing(limits: Limits, state: GateState, setpoint: Setpoint, now_ns: int) -> GateState:
    """Return the state with how near people are: the target, while it is not seen as it was last; others."""
    if Reason.TOO_CLOSE in limits.switched_off:
        return state
    if setpoint.target_share is not None or setpoint.others_share is not None:
        state = replace(state, seen_ns=setpoint.t_ns if setpoint.seen_ns is None else setpoint.seen_ns)
    if setpoint.target_share is not None:
        state = replace(state, target_m=_away_m(setpoint.target_share))
    if setpoint.others_share is not None:
        away_m = _away_m(setpoint.others_share)
        if away_m <= max(state.others_m, _away_m(limits.largest_others)) or _have_passed(
            limits, state, now_ns
        ):
            state = replace(state, others_m=away_m, others_ns=now_ns)
    return state


def _away_m(share: float) -> float:
    """Return about how far away a person is who covers this share of the image, m; 0 for not a number."""
    return math.sqrt(FILLED_M2 / share) if share > 0 else math.inf if share == 0 else 0.0


def _have_passed(limits: Limits, state: GateState, now_ns: int) -> bool:
    return (now_ns - state.others_ns) / 1e9 >= limits.passing_s


def _ahead_m_s(limits: Limits, state: GateState, now_ns: int) -> float:
    """Return how fast the robot may go ahead for the target and others: none too near, and no faster than it
    can stop within the room that a picture of this age showed (speed and separation monitoring, ISO/TS
    15066). Where there are no more pictures, only a hand drives on, by its own eyes, so the target does not
    slow it down more and more."""
    age_s = max(now_ns - state.seen_ns, 0) / 1e9
    room_m = state.target_m - _away_m(limits.largest_target)
    fastest = fastest_m_s(limits, room_m, min(age_s, limits.sight_timeout_s))
    if _have_passed(limits, state, now_ns):
        return fastest
    room_m = state.others_m - _away_m(limits.largest_others)
    return min(fastest, fastest_m_s(limits, room_m, age_s))


def narrowed(
    limits: Limits, state: GateState, robot: PlatformState, now_ns: int
) -> tuple[tuple[Reason, Envelope], ...]:
    """Return the envelopes that apply now, each inside the one before, with the reason for commands it
    cuts."""
    full = Envelope.of(limits)
    ramp = full.times(ramped(limits, state, now_ns))
    # turning and backing away stay allowed
    near = replace(ramp, forward=min(ramp.forward, _ahead_m_s(limits, state, now_ns)))
    return (
        (Reason.ENVELOPE, full),
        (Reason.RAMP, ramp),
        (Reason.TOO_CLOSE, near),
        (Reason.ALTITUDE, _level(near, limits, state, robot)),
    )


def _level(envelope: Envelope, limits: Limits, state: GateState, robot: PlatformState) -> Envelope:
    """Return the envelope without vertical motion that leads out of the altitude band."""
    if limits.altitude_m is None or robot.pose is None or Reason.ALTITUDE in limits.switched_off:
        return envelope
    low, high = limits.altitude_m
    height_m = rest_height_m(limits, robot.pose, robot.velocity or state.last)
    return replace(
        envelope,
        up=envelope.up if height_m < high else 0.0,
        down=envelope.down if height_m > low else 0.0,
    )
