"""Runs one viewing: perception and policy on a camera, drawn and counted, without a robot."""

from __future__ import annotations

import itertools
import time
from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from adatracker_deploy.core.camera import FilmOverError
from adatracker_deploy.core.messages import TargetState
from adatracker_deploy.perception.overlay import Drive, overlay
from adatracker_deploy.perception.pipeline import perceive
from adatracker_deploy.policy.onnx_policy import OnnxPolicy
from adatracker_deploy.runtime.pacer import Pacer
from adatracker_deploy.runtime.rate_adapter import RateAdapter

if TYPE_CHECKING:
    from collections.abc import Iterator

    from adatracker_deploy.core.camera import Camera
    from adatracker_deploy.core.clock import Clock
    from adatracker_deploy.core.messages import Action, Frame, Observation
    from adatracker_deploy.perception.film import FilmCamera
    from adatracker_deploy.perception.overlay import Image
    from adatracker_deploy.perception.segmenter import Segmenter
    from adatracker_deploy.policy.base import Policy

_LOOK_HZ = 120.0
"""Polling rate of a live camera, faster than any camera's frame rate."""
UNCHOSEN = "unchosen"
"""Target state before anybody has been chosen."""


class Viewed(NamedTuple):
    """One processed frame."""

    frame: Frame
    observation: Observation
    action: Action | None
    took_ms: float
    """Time of perception and policy."""


class _Counted(NamedTuple):
    """The counts for each frame."""

    took_ms: float
    state: str
    in_sight: bool
    done_s: float


class Viewer:
    """Processes frames in order and keeps statistics.

    Args:
        segmenter: finds the target.
        policy: runs at its own rate; None for no policy.
    """

    def __init__(self, segmenter: Segmenter, policy: Policy | None) -> None:
        self._segmenter = segmenter
        self._policy = policy
        segmenter.reset()
        if policy is not None:
            policy.reset()
        self._cadence = RateAdapter(policy) if policy is not None else None
        self._began_s, self._first_ns = 0.0, 0
        self._counted: list[_Counted] = []

    def look(self, frame: Frame) -> Viewed:
        """Segment and ask the policy.

        Raises:
            PlatformError: the segmenter fails.
        """
        began_s = time.perf_counter()
        if not self._counted:
            self._began_s, self._first_ns = began_s, frame.t_ns
        observation = perceive(frame, self._segmenter).observation
        shown = replace(observation, image=frame.rgb)
        action = self._cadence.act(shown) if self._cadence is not None else None
        took_ms = (time.perf_counter() - began_s) * 1e3
        in_sight = observation.box is not None  # all at once, so that an interrupt leaves it complete
        self._counted.append(_Counted(took_ms, _state_name(observation), in_sight, time.perf_counter()))
        return Viewed(frame, observation, action, took_ms)

    def drawn(self, viewed: Viewed, clock: Clock | None = None) -> Image:
        """Draw a processed frame, with the age of a live one by the run's clock, or its time in a video."""
        frame, observation = viewed.frame, viewed.observation
        since_ns = frame.t_ns - self._first_ns
        when = f"age {(clock.now_ns() - frame.t_ns) / 1e6:.0f} ms" if clock else f"{since_ns / 1e9:.2f} s"
        return overlay(frame.rgb, observation, when, self._drive(viewed))

    def moves(self, viewed: Viewed) -> dict[str, float] | None:
        """Return where the policy would go, in shares of a robot's limits, by axis (REP 103).

        None where it was not asked.
        """
        if self._policy is None or viewed.action is None:
            return None
        signed = zip(self._policy.info.action, map(float, viewed.action.values), strict=True)
        return {entry.axis: value * entry.sign for entry, value in signed if entry.unit == "limit"}

    def summary(self) -> dict[str, Any]:
        """Return statistics: `tracked` is the share of frames in which the target was seen, `frame_ms` the
        time of perception and policy per frame, without drawing.
        """
        counted = self._counted
        states = Counter(frame.state for frame in counted)
        took_ms = [frame.took_ms for frame in counted]
        return {
            "frames": len(counted),
            "rate_hz": round(len(counted) / (counted[-1].done_s - self._began_s), 2) if counted else None,
            "tracked": round(sum(frame.in_sight for frame in counted) / len(counted), 4) if counted else None,
            "states": {name: states[name] for name in (*(state.value for state in TargetState), UNCHOSEN)},
            "frame_ms": {
                f"p{share}": round(float(np.percentile(took_ms, share)), 2) if counted else None
                for share in (50, 95)
            },
        }

    def _drive(self, viewed: Viewed) -> Drive | None:
        if self._policy is None:
            return None
        sees = self._policy.picture(viewed.observation) if isinstance(self._policy, OnnxPolicy) else None
        return Drive(moves=self.moves(viewed), sees=sees)


def film_frames(camera: FilmCamera, clock: Clock, *, paced: bool) -> Iterator[Frame]:
    """Yield every frame of an open video, at the video's times; `camera` gives every frame.

    Args:
        camera: made with `every_frame`.
        clock: the run's.
        paced: do not yield a frame before its time.
    """
    began_ns = clock.now_ns()
    for number in itertools.count():
        t_ns = began_ns + round(number * 1e9 / camera.rate_hz)
        if paced:
            clock.sleep_until(t_ns)
        try:
            frame = camera.read(t_ns)
        except FilmOverError:
            return
        if frame is None:
            return
        yield frame


def live_frames(camera: Camera, clock: Clock) -> Iterator[Frame]:
    """Yield each new frame; frames that arrive while one is processed are skipped.

    Raises:
        PlatformError: the camera is lost.
    """
    pacer, seen = Pacer(clock, _LOOK_HZ), 0
    while True:
        frame = camera.read(pacer.wait().t_ns)
        if frame is not None and frame.seq != seen:
            seen = frame.seq
            yield frame


def _state_name(observation: Observation) -> str:
    if observation.target is None:  # a rehearsal knows the target
        return TargetState.TRACKED.value if observation.box is not None else UNCHOSEN
    return observation.target.value
