"""Turns a fresh command into the velocity that is sent."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from adatracker_deploy.config.limits import Limits
from adatracker_deploy.core.messages import PlatformState, Twist
from adatracker_deploy.runtime.gate.envelope import Envelope, narrowed
from adatracker_deploy.runtime.gate.reasons import Reason
from adatracker_deploy.runtime.gate.smooth import smooth
from adatracker_deploy.runtime.gate.state import GateState

if TYPE_CHECKING:
    from collections.abc import Iterable


def move(
    limits: Limits, state: GateState, asked: Twist, robot: PlatformState, dt_s: float
) -> tuple[GateState, tuple[Reason, ...]]:
    """Move from the last velocity towards the requested one; return the next state and the reasons for
    changes.

    The request is clipped to every envelope, then smoothed. Smoothing stays inside an envelope that does not
    shrink. One that has shrunk (the target is too close, the edge of the altitude band is reached) cuts its
    axis at once, without smoothing, as a stop does.

    Args:
        limits: the profile's.
        state: with `last_ns` the time now.
        asked: the requested velocity, finite.
        robot: the robot's newest state.
        dt_s: time since the last velocity was sent, s.
    """
    narrow = narrowed(limits, state, robot, state.last_ns)
    wanted, reasons = _clip(asked, narrow)
    eased, _ = smooth(limits, state.last, state.rate, wanted, dt_s, jerk=False)
    jerk = Reason.JERK not in limits.switched_off
    smoothed, rate = smooth(limits, state.last, state.rate, wanted, dt_s, jerk=jerk)
    _, (_, ramp), *sudden = narrow
    out, cut = _clip(ramp.clip(smoothed), sudden)  # the first clip removes rounding errors
    rate = replace(
        rate, vx=rate.vx if out.vx == smoothed.vx else 0.0, vz=rate.vz if out.vz == smoothed.vz else 0.0
    )
    changed = {
        **dict.fromkeys(reasons, True),
        **dict.fromkeys(cut, True),
        Reason.ACCELERATION: eased != wanted,
        Reason.JERK: smoothed != eased,
    }
    return replace(state, last=out, rate=rate), tuple(reason for reason, is_so in changed.items() if is_so)


def _clip(twist: Twist, narrow: Iterable[tuple[Reason, Envelope]]) -> tuple[Twist, list[Reason]]:
    """Clip a velocity to one envelope after the other; return it and the reasons."""
    reasons = []
    for reason, envelope in narrow:
        before, twist = twist, envelope.clip(twist)
        if twist != before:
            reasons.append(reason)
    return twist, reasons
