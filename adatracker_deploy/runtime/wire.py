"""Serialises set-points and status for the shared memory between tracker and link."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

from adatracker_deploy.core.geometry import Pose
from adatracker_deploy.core.messages import PlatformState, Twist
from adatracker_deploy.runtime.gate import Setpoint
from adatracker_deploy.runtime.link import Acted, LinkStatus, Phase

SETPOINT_BYTES = 512
STATUS_BYTES = 16384
_LONGEST_TEXT = 200


def pack_setpoint(setpoint: Setpoint) -> bytes:
    """Encode a set-point; NaN and infinities survive, so that the gate sees them."""
    return json.dumps(
        [
            *(setpoint.t_ns, setpoint.target_share, setpoint.seen_ns),
            *(setpoint.held_until_ns, setpoint.others_share),
            *dataclasses.astuple(setpoint.twist),
        ]
    ).encode()


def unpack_setpoint(message: bytes) -> Setpoint:
    """Decode a set-point."""
    *told, vx, vy, vz, yaw_rate = json.loads(message)
    return Setpoint(Twist(vx, vy, vz, yaw_rate), *told)


def pack_status(status: LinkStatus) -> bytes:
    """Encode a status; its texts are truncated so that it always fits."""
    state = dataclasses.replace(
        status.state, stopped=status.state.stopped[:_LONGEST_TEXT], mode=status.state.mode[:64]
    )
    short = dataclasses.replace(
        status,
        state=state,
        stopped=status.stopped[:_LONGEST_TEXT],
        reasons=tuple(reason[:_LONGEST_TEXT] for reason in status.reasons[:8]),
    )
    return json.dumps(dataclasses.asdict(short)).encode()


def unpack_status(message: bytes) -> LinkStatus:
    """Decode a status."""
    fields: dict[str, Any] = json.loads(message)
    state = fields["state"]
    state["pose"] = state["pose"] and Pose(**state["pose"])
    state["velocity"] = state["velocity"] and Twist(**state["velocity"])
    return LinkStatus(
        phase=Phase(fields["phase"]),
        state=PlatformState(**state),
        sent=Twist(**fields["sent"]),
        reasons=tuple(fields["reasons"]),
        stopped=fields["stopped"],
        takeover=fields["takeover"],
        t_ns=fields["t_ns"],
        acted=fields["acted"] and Acted(**fields["acted"]),
    )
