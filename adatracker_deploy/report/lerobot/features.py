"""Features of the data set: their names, types and shapes, and the numbers of an episode."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from adatracker_deploy.core.task import is_box

if TYPE_CHECKING:
    from adatracker_deploy.core.messages import Box, Twist
    from adatracker_deploy.trial.episodes import Episode

CAMERA, MASK = "observation.images.camera", "observation.images.mask"
STATE = "observation.state"
AXES = ("vx", "vy", "vz", "yaw_rate")
"""Body frame of REP 103, m/s and rad/s."""
VECTORS: dict[str, tuple[str, ...]] = {
    STATE: AXES,  # measured
    "observation.target": ("cx", "cy", "w", "h", "seen"),  # the box in fractions of the picture, or zeros
    "action": AXES,  # sent by the link, after its gate
    "command": AXES,  # asked for by the policy, before it
}
"""Names of the numbers of each vector, float32. lerobot takes ``observation`` for inputs of a policy and
``action`` for its outputs, and passes on the rest."""
SCALARS: dict[str, str] = {
    "next.reward": "float32",  # R of the next tick's box
    "next.done": "bool",  # the task ended there
    "trial.tick": "int64",  # the log's number of this tick
    "trial.time_s": "float64",  # its time since the trial's first tick, by the run's clock
    "timestamp": "float32",  # since the episode's first row, by the data set's rate
    "frame_index": "int64",  # in the episode
    "episode_index": "int64",
    "index": "int64",  # in the data set
    "task_index": "int64",
}
"""Types; the last five are lerobot's own."""
CODEC, PIXELS = "vp9", "yuv420p"

Columns = dict[str, NDArray[Any]]
"""Numbers of N rows: (N, D) of a vector, (N,) of a scalar."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Properties that all trials of a data set share."""

    rate_hz: float
    camera: tuple[int, int] | None
    """Height and width of the video; None where the logs keep no pictures."""
    mask: tuple[int, int]
    """Height and width."""
    has_state: bool
    """The robots' velocity is known at every tick."""

    def features(self) -> dict[str, dict[str, Any]]:
        """Return the ``features`` of ``meta/info.json``."""
        channels = ["height", "width", "channels"]
        found: dict[str, dict[str, Any]] = {}
        if self.camera is not None:
            info = {
                "video.height": self.camera[0],
                "video.width": self.camera[1],
                "video.codec": CODEC,
                "video.pix_fmt": PIXELS,
                "video.is_depth_map": False,
                "video.fps": self.rate_hz,
                "video.channels": 3,
                "has_audio": False,
            }
            found[CAMERA] = {"dtype": "video", "shape": [*self.camera, 3], "names": channels, "info": info}
        found[MASK] = {"dtype": "image", "shape": [*self.mask, 3], "names": channels}
        for key, names in VECTORS.items():
            if key != STATE or self.has_state:
                found[key] = {"dtype": "float32", "shape": [len(names)], "names": list(names)}
        for key, kind in SCALARS.items():
            found[key] = {"dtype": kind, "shape": [1], "names": None}
        return found


def columns(
    episode: Episode, *, rate_hz: float, began_ns: int, number: int, first: int, has_state: bool
) -> Columns:
    """Return an episode's numbers, row by row.

    Args:
        episode: of N transitions.
        rate_hz: of the data set.
        began_ns: when its trial began.
        number: the episode's, in the data set.
        first: the number of its first row, in the data set.
        has_state: the velocity is known at every tick.
    """
    ticks = [transition.tick for transition in episode]
    place = np.arange(len(episode))
    found: Columns = {
        "observation.target": np.array([_box(tick.box) for tick in ticks], np.float32),
        "action": np.array([_axes(transition.sent) for transition in episode], np.float32),
        "command": np.array([_axes(tick.command) for tick in ticks], np.float32),
        "next.reward": np.array([transition.reward for transition in episode], np.float32),
        "next.done": np.array([transition.done for transition in episode], np.bool_),
        "trial.tick": np.array([tick.step for tick in ticks], np.int64),
        "trial.time_s": np.array([(tick.t_ns - began_ns) / 1e9 for tick in ticks], np.float64),
        "timestamp": (place / rate_hz).astype(np.float32),
        "frame_index": place.astype(np.int64),
        "episode_index": np.full(len(episode), number, np.int64),
        "index": first + place.astype(np.int64),
        "task_index": np.zeros(len(episode), np.int64),
    }
    if has_state:
        moved = [_axes(tick.velocity) for tick in ticks if tick.velocity is not None]
        found[STATE] = np.array(moved, np.float32)
    return found


def knows_state(episode: Episode) -> bool:
    """Return whether the robot's velocity is known at every tick."""
    return all(one.tick.velocity is not None and one.tick.velocity.is_finite() for one in episode)


def _axes(twist: Twist) -> tuple[float, ...]:
    return tuple(getattr(twist, axis) for axis in AXES)


def _box(box: Box | None) -> tuple[float, ...]:
    return (box.cx, box.cy, box.w, box.h, 1.0) if box is not None and is_box(box) else (0.0,) * 5
