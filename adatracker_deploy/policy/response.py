"""The response: how late the body obeys, from what it was told and how the target then moved in the picture.

The same command turns the picture at once on one body and half a second later on another, and a policy that
takes one for the other swings. So nominal bodies of many delays and lags are simulated side by side with the
commands that were given (a bank of models, as in multiple-model estimation). How well the turn of each
explains the target's motion says how likely it is: a regression with exponential forgetting, less the slow
part, which is the target's own. That is a cross-correlation of commands and image motion in closed form.
What a network is told follows from it: delay, lag, and what commands that have not worked yet will still do.

Like `belief`, it needs no calibration, and works on any leading dimensions. Ours, not the paper's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.policy.belief import NOMINAL_YAW_RAD_S, Array, bearing_of

_DELAYS_S = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
_LAGS_S = (0.0, 0.15, 0.3, 0.5, 0.8, 1.2)
DELAY_S: Final[Array] = np.repeat(np.array(_DELAYS_S, np.float32), len(_LAGS_S))
LAG_S: Final[Array] = np.tile(np.array(_LAGS_S, np.float32), len(_DELAYS_S))
"""Delay and lag of each nominal body (B,); they cover the condition `wide`."""
LONGEST_DELAY_S: Final = _DELAYS_S[-1]
"""A network is told delays in units of it."""
_B = len(DELAY_S)

COLUMNS = (
    *("evidence", "delay", "delay_spread", "lag", "lag_spread", "gain"),
    *("turn_under_way", "turning", "drive_under_way", "driving", "bearing_then", "pace"),
)
"""Inputs of a network, each about -1 to 1. Five are of the moment at which the next command begins to work:
how far the body turns until then and how fast it turns then, the same of its drive, and where the target is
then, if it stands still. The last is the target's own angular speed about the camera, left positive."""
SIZE = len(COLUMNS)

_SLOW_S = 0.2
"""Time constant of what is taken for the target's own motion; of 0.2 to 1.2 s, this told delays best."""
_FORGET_S = 30.0
"""Bodies change, but seldom."""
_NOISE_RAD2 = 1e-5
"""Variance of a bearing's change by the pixels of a mask: a tenth of one of 64."""
_PRIOR_RAD2 = 1e-3
"""Weight of the nominal gain in a regression: that of some ten changes of the command by a third."""
_MOST_STEP_RAD = 0.3
"""The target's bearing does not change more in a step; a false blob's does."""
_EDGE = 0.97
"""A target that reaches further to a side, in half pictures, may be cut off; its middle is not its own."""
_ENOUGH_STEPS = 30.0
_BEARING_UNIT_RAD = math.radians(60.0)
_PACE_UNIT_RAD_S = 2.0
_SMOOTH_S = 0.3
"""Time constant of the pace: a walking person's outline sways with every stride."""
_LONG_S = 1.0
"""A pace measured over a longer gap is none."""
_MOST_PACE_RAD_S = 3.0


@dataclass(frozen=True, slots=True)
class Evidence:
    """What is known after a picture; every array begins with the same leading dimensions (...)."""

    commands: Array
    """(..., Q, 2), the newest first: forward and yaw, fractions of the limits."""
    speeds: Array
    """(..., 2, B), of each nominal body, likewise."""
    slow: Array
    """(..., 1 + B), slow parts: of the target's motion and of each body's turn, rad a step."""
    products: Array
    """(..., 1 + B), sums of motion x motion and of turn x motion, rad^2."""
    squares: Array
    """(..., B), sums of turn x turn, rad^2."""
    steps: Array
    """(..., 1), how many steps count."""
    bearing: Array
    """(..., 1), of the target when it was last seen, rad."""
    gap_s: Array
    """(..., 1), the time since."""
    swept: Array
    """(..., B), how far each nominal body has turned since, in seconds of full turning."""
    pace: Array
    """(..., B), the target's own angular speed as each nominal body has it, rad/s."""
    whole: NDArray[np.bool_]
    """(..., 1), whether it was in that picture, and not cut off."""


def initial(*shape: int, period_s: float) -> Evidence:
    """Return the state before the first picture: nothing was commanded."""
    queue = round(_DELAYS_S[-1] / period_s) + 1

    def zeros(*inner: int) -> Array:
        return np.zeros((*shape, *inner), np.float32)

    return Evidence(
        commands=zeros(queue, 2),
        speeds=zeros(2, _B),
        slow=zeros(1 + _B),
        products=zeros(1 + _B),
        squares=zeros(_B),
        steps=zeros(1),
        bearing=zeros(1),
        gap_s=zeros(1) + np.float32(_LONG_S),
        swept=zeros(_B),
        pace=zeros(_B),
        whole=np.zeros((*shape, 1), np.bool_),
    )


def advance(state: Evidence, sight: Array, drive: Array, period_s: float) -> Evidence:
    """Return the state after one more picture; arguments as for `belief.advance`."""
    newest = np.clip(drive, -1.0, 1.0)[..., None, :]
    commands = np.concatenate((newest, state.commands[..., :-1, :]), axis=-2)
    obeyed = np.swapaxes(commands[..., _late(period_s), :], -1, -2)
    speeds = state.speeds + _share(period_s) * (obeyed - state.speeds)

    seen, bearing = sight[..., :1] > 0, bearing_of(sight[..., 1:2])
    whole = seen & (np.abs(sight[..., 1:2]) + sight[..., 3:4] < _EDGE)
    counts = whole & state.whole
    moved = np.clip(bearing - state.bearing, -_MOST_STEP_RAD, _MOST_STEP_RAD)
    motion = np.concatenate((moved, -speeds[..., 1, :] * period_s), axis=-1)
    quick = 1.0 - math.exp(-period_s / _SLOW_S)
    slow = np.where(counts, state.slow + quick * (motion - state.slow), state.slow)
    fast = motion - slow
    kept = math.exp(-period_s / _FORGET_S)

    def summed(total: Array, more: Array) -> Array:
        return (kept * total + np.where(counts, more, 0.0)).astype(np.float32)

    swept = state.swept + speeds[..., 1, :] * period_s
    gap_s = state.gap_s + np.float32(period_s)
    measured = (bearing - state.bearing + _gains(state) * swept) / gap_s
    measured = np.clip(measured, -_MOST_PACE_RAD_S, _MOST_PACE_RAD_S)
    smoothed = state.pace + (measured - state.pace) * gap_s / (_SMOOTH_S + gap_s)
    pace = np.where(seen, np.where(gap_s <= _LONG_S, smoothed, 0.0), state.pace)

    return Evidence(
        commands=commands.astype(np.float32),
        speeds=speeds.astype(np.float32),
        slow=slow.astype(np.float32),
        products=summed(state.products, fast * fast[..., :1]),
        squares=summed(state.squares, fast[..., 1:] ** 2),
        steps=summed(state.steps, np.ones_like(state.steps)),
        bearing=np.where(seen, bearing, state.bearing).astype(np.float32),
        gap_s=np.where(seen, 0.0, np.minimum(gap_s, 2.0 * _LONG_S)).astype(np.float32),
        swept=np.where(seen, 0.0, swept).astype(np.float32),
        pace=pace.astype(np.float32),
        whole=whole,
    )


def likelihood(state: Evidence) -> tuple[Array, Array]:
    """Return how likely each nominal body is, (..., B) of sum 1, and its gain (..., B).

    A gain is how far a second of full turning moves the target, rad. The likelihood is that of a linear
    regression with Gaussian errors of unknown variance: its residual to the power of -n / 2.
    """
    motion, products = state.products[..., :1], state.products[..., 1:]
    gain = _gains(state)
    noise = _NOISE_RAD2 * (1.0 + state.steps)
    residual = np.maximum(motion - 2.0 * gain * products + gain**2 * state.squares, 0.0) + noise
    logarithm = -0.5 * state.steps * np.log(residual / (motion + noise))
    weight = np.exp(logarithm - logarithm.max(-1, keepdims=True))
    return weight / weight.sum(-1, keepdims=True), gain


def _gains(state: Evidence) -> Array:
    pulled = state.products[..., 1:] + _PRIOR_RAD2 * NOMINAL_YAW_RAD_S
    gains: Array = np.maximum(pulled, 0.0) / (state.squares + _PRIOR_RAD2)
    return gains


def told(state: Evidence, period_s: float) -> Array:
    """Return what a network reads of a state, float32 of shape (..., SIZE).

    Args:
        state: after this picture.
        period_s: between two pictures.
    """
    likely, gains = likelihood(state)
    delay, delay_spread = _moments(likely, DELAY_S)
    lag, lag_spread = _moments(likely, LAG_S)
    gain = (likely * gains).sum(-1)
    speeds, driven = state.speeds, np.zeros_like(state.speeds)
    late, share = _late(period_s), _share(period_s)
    for ahead in range(int(late.max())):
        command = np.swapaxes(state.commands[..., np.maximum(late - 1 - ahead, 0), :], -1, -2)
        speeds = np.where(ahead < late, speeds + share * (command - speeds), speeds)
        driven = np.where(ahead < late, driven + speeds * period_s, driven)
    (forward, turn), (drive, swept) = (
        np.moveaxis((likely[..., None, :] * value).sum(-1), -1, 0) for value in (speeds, driven)
    )
    since = (likely * state.swept).sum(-1)
    values = (
        state.steps[..., 0] / (_ENOUGH_STEPS + state.steps[..., 0]),
        delay / LONGEST_DELAY_S,
        delay_spread / LONGEST_DELAY_S,
        lag,
        lag_spread,
        gain / (2.0 * NOMINAL_YAW_RAD_S),
        gain * swept,
        gain * turn / NOMINAL_YAW_RAD_S,
        drive / LONGEST_DELAY_S,
        forward,
        (state.bearing[..., 0] - gain * (swept + since)) / _BEARING_UNIT_RAD,
        (likely * state.pace).sum(-1) / _PACE_UNIT_RAD_S,
    )
    return np.stack([np.asarray(value, np.float32) for value in values], axis=-1)


def _moments(likely: Array, values: Array) -> tuple[Array, Array]:
    """Return mean and standard deviation (...) of values (B,)."""
    mean = (likely * values).sum(-1)
    return mean, np.sqrt((likely * (values - mean[..., None]) ** 2).sum(-1))


def _late(period_s: float) -> NDArray[np.int64]:
    """Return the delay of each nominal body in steps, (B,)."""
    steps: NDArray[np.int64] = np.rint(DELAY_S / period_s).astype(np.int64)
    return steps


def _share(period_s: float) -> Array:
    """Return the share of a difference in speed that each nominal body closes in a step, (B,)."""
    return (1.0 - np.exp(-period_s / np.maximum(LAG_S, 1e-6))).astype(np.float32)


def kept_where(kept: NDArray[np.bool_], one: Evidence, other: Evidence) -> Evidence:
    """Return `one` where `kept` (N,) is true and `other` elsewhere; N is their leading dimension."""

    def chosen(name: str) -> Any:
        first, second = getattr(one, name), getattr(other, name)
        return np.where(kept.reshape(-1, *[1] * (first.ndim - 1)), first, second)

    return Evidence(**{field.name: chosen(field.name) for field in fields(Evidence)})
