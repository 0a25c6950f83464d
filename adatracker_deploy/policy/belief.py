"""The belief across gaps: where the target was last seen, and what has been commanded since.

A mask without the target says nothing about where it went. So a policy may be told, every tick, when and
where the target was last seen and how far the body has been told to turn and drive since then. Training,
export, evaluation, rehearsals and robots all compute it here, from the policy's own input and its own last
actions. No calibration enters: a drive is a fraction of the body's limits times seconds.

`advance` takes one step and `told` is what the network reads; both work on any leading dimensions, so one
robot and ten thousand logged episodes go through the same arithmetic. Ours, not the paper's.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from adatracker_deploy.policy.base import ActionSpec
    from adatracker_deploy.policy.manifest import MaskSpec

Array = NDArray[np.float32]

SIGHT = ("seen", "left", "up", "width", "height")
"""Columns of a sight: 1 or 0; the target's centre from the middle, in half pictures, left and up positive;
its width and height as shares of the picture. All 0 where there is no target."""
STATE = (
    "seen",
    "gap_s",
    "left",
    "up",
    "width",
    "height",
    "pace_rad_s",
    "turned_s",
    "driven_s",
    "usual_rad_s",
)
"""Columns of a state: the last sight; the time since; the target's angular speed about the camera; the yaw
and the forward command since, each a fraction of its limit times seconds (left and forward positive); the
root mean square of the angular speed while it was seen."""
COLUMNS = (
    *("seen", "gap", "left", "up", "width", "height", "pace", "turned", "driven"),
    *("bearing_sin", "bearing_cos"),
)
"""Inputs of a network, each about -1 to 1; the last two are the expected bearing, left positive, of the
target from a nominal body."""
SIZE = len(COLUMNS)

LONGEST_S = 5.0
"""A gap counts no further: this long without a target ends an episode."""
_GAP_UNIT_S = 0.1
"""The gap is told by its logarithm from here on, so that short ones differ as long ones do."""
_DRIVE_S = 3.0
"""Unit of what was driven: about a full turn of the nominal body."""
_MOST_DRIVE_S = 6.0
_NOMINAL_TAN = 1.0
"""Tangent of half the nominal field of view, 90 degrees."""
NOMINAL_YAW_RAD_S = math.radians(120.0)
"""Yaw limit of the nominal body, that of the paper's test bodies."""
_COAST_S = 1.0
"""The target is expected to keep its pace for so long: the reach of the hand-written controller that showed
what a belief is worth. A pace measured over a longer gap is none."""
_SMOOTH_S = 0.3
"""Time constant of the pace: a walking person's outline sways with every stride."""
_MOST_PACE_RAD_S = 3.0
_USUAL_RAD_S, _USUAL_S = 0.5, 3.0
"""What the usual angular speed is before anything was seen, and the time constant with which it is learnt."""


def initial(*shape: int) -> Array:
    """Return the state before the first picture, (*shape, len(STATE)): nothing was ever seen."""
    state = np.zeros((*shape, len(STATE)), np.float32)
    state[..., STATE.index("gap_s")] = LONGEST_S
    state[..., STATE.index("usual_rad_s")] = _USUAL_RAD_S
    return state


def sight_of(target: NDArray[np.bool_]) -> Array:
    """Return what pictures show of the target, float32 of shape (..., len(SIGHT)).

    Centre and size are moments of all its pixels (an even bar has its own width), so that a false blob of
    a few pixels moves them little where a box would jump.

    Args:
        target: (..., S, S), which pixels are the target's.
    """
    side = target.shape[-1]
    place = (np.arange(side) - (side - 1) / 2) * (2.0 / side)
    across = target.sum(-2, dtype=np.int32).astype(np.float64)
    down = target.sum(-1, dtype=np.int32).astype(np.float64)
    count = across.sum(-1)
    share = np.maximum(count, 1.0)
    x, y = across @ place / share, down @ place / share
    spread_x = np.maximum(across @ place**2 / share - x**2, 0.0)
    spread_y = np.maximum(down @ place**2 / share - y**2, 0.0)
    # Variance of n pixels in a row, 2 / side apart: (n^2 - 1) / 12 * (2 / side)^2.
    width, height = (np.sqrt(3.0 * spread + side**-2.0) for spread in (spread_x, spread_y))
    seen = count > 0
    sight: Array = np.stack([seen, -x, -y, width, height], axis=-1).astype(np.float32)
    return np.where(seen[..., None], sight, np.float32(0))


def target_pixels(picture: Array, mask: MaskSpec) -> NDArray[np.bool_]:
    """Return which pixels (S, S) of an input (C, S, S) have the target's colour, to half a grey level."""
    colour = np.array(mask.palette.target, np.float32)[:, None, None] * mask.scale
    return np.all(np.abs(picture - colour) <= 0.5 * mask.scale, axis=0)  # type: ignore[no-any-return]


def drive_of(values: Array, action: ActionSpec) -> Array:
    """Return the forward and yaw fractions (..., 2), forward and left positive, of actions (..., A)."""
    axes = [entry.axis for entry in action]
    columns = [values[..., axes.index(axis)] * action[axes.index(axis)].sign for axis in ("forward", "yaw")]
    return np.stack(columns, axis=-1).astype(np.float32)


def advance(state: Array, sight: Array, drive: Array, period_s: float) -> Array:
    """Return the state after one more picture.

    Args:
        state: (..., len(STATE)), of the picture before; `initial` before the first.
        sight: (..., len(SIGHT)), of this picture.
        drive: (..., 2), commanded since the picture before: forward and yaw, fractions of the limits.
        period_s: between two pictures.
    """
    _, gap, left, up, width, height, pace, turned, driven, usual = np.moveaxis(state, -1, 0)
    now = np.clip(drive, -1.0, 1.0) * np.float32(period_s)
    turned = np.clip(turned + now[..., 1], -_MOST_DRIVE_S, _MOST_DRIVE_S)
    driven = np.clip(driven + now[..., 0], -_MOST_DRIVE_S, _MOST_DRIVE_S)
    seen = sight[..., 0] > 0
    since = gap + np.float32(period_s)
    swept = bearing_of(sight[..., 1]) - bearing_of(left) + NOMINAL_YAW_RAD_S * turned
    measured = np.clip(swept / since, -_MOST_PACE_RAD_S, _MOST_PACE_RAD_S)
    smoothed = pace + (measured - pace) * since / (_SMOOTH_S + since)
    pace = np.where(seen, np.where(since <= _COAST_S, smoothed, 0.0), pace)
    learnt = np.where(seen, np.float32(period_s / _USUAL_S), 0.0)
    values = (
        seen,
        np.where(seen, 0.0, np.minimum(since, LONGEST_S)),
        *(np.where(seen, sight[..., 1 + i], last) for i, last in enumerate((left, up, width, height))),
        pace,
        np.where(seen, 0.0, turned),
        np.where(seen, 0.0, driven),
        np.sqrt(usual**2 + (pace**2 - usual**2) * learnt),
    )
    return np.stack([np.asarray(value, np.float32) for value in values], axis=-1)


def told(state: Array) -> Array:
    """Return what a network reads of a state, float32 of shape (..., SIZE)."""
    seen, gap, left, up, width, height, pace, turned, driven, _ = np.moveaxis(state, -1, 0)
    expected = bearing_of(left) + pace * np.minimum(gap, _COAST_S) - NOMINAL_YAW_RAD_S * turned
    values = (
        seen,
        np.log1p(gap / _GAP_UNIT_S) / math.log1p(LONGEST_S / _GAP_UNIT_S),
        *(left, up, width, height),
        pace / _MOST_PACE_RAD_S,
        turned / _DRIVE_S,
        driven / _DRIVE_S,
        np.sin(expected),
        np.cos(expected),
    )
    return np.stack([np.asarray(value, np.float32) for value in values], axis=-1)


def bearing_of(left: Array) -> Array:
    """Return the bearing, rad, of a place in a nominal camera's picture."""
    angle: Array = np.arctan(_NOMINAL_TAN * left)
    return angle
