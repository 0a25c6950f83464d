"""One viewing: what perception and policy make of a camera, drawn and counted, without any robot."""

from __future__ import annotations

import itertools
import time
from collections import Counter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from adatracker_deploy.messages import TargetState
from adatracker_deploy.perception.camera import FilmOverError
from adatracker_deploy.perception.overlay import Drive, overlay
from adatracker_deploy.perception.pipeline import perceive
from adatracker_deploy.policy.onnx_policy import OnnxPolicy
from adatracker_deploy.runtime.cadence import Cadence
from adatracker_deploy.runtime.pacer import Pacer

if TYPE_CHECKING:
    from collections.abc import Iterator

    from adatracker_deploy.messages import Action, Frame, Observation
    from adatracker_deploy.perception.camera import Camera
    from adatracker_deploy.perception.film import FilmCamera
    from adatracker_deploy.perception.overlay import Image
    from adatracker_deploy.perception.segmenter import Segmenter
    from adatracker_deploy.policy.base import Policy
    from adatracker_deploy.runtime.clock import Clock

_LOOK_HZ = 120.0
"""How often a live camera is asked for its newest frame: more often than any camera has one."""
UNCHOSEN = "unchosen"
"""Among the states: nobody has been chosen yet."""


class Viewed(NamedTuple):
    """One frame that was looked at."""

    picture: Image
    """With everything drawn over it."""
    observation: Observation
    action: Action | None


class Viewer:
    """Looks at frames one after the other and keeps count; no time but the frames' own is in its pictures.

    Args:
        segmenter: finds the target.
        policy: answers at its own rate; None leaves its answer out.
    """

    def __init__(self, segmenter: Segmenter, policy: Policy | None) -> None:
        self._segmenter = segmenter
        self._policy = policy
        segmenter.reset()
        if policy is not None:
            policy.reset()
        self._cadence = Cadence(policy) if policy is not None else None
        self._began_s = self._ended_s = 0.0
        self._first_ns = 0
        self._took_ms: list[float] = []
        self._states: Counter[str] = Counter()
        self._in_sight = 0

    def look(self, frame: Frame, clock: Clock | None = None) -> Viewed:
        """Segment, ask the policy and draw.

        Args:
            frame: the next one.
            clock: the run's, to show how old a live frame is; of a film its time is shown.

        Raises:
            PlatformError: the segmenter fails.
        """
        began_s = time.perf_counter()
        if not self._took_ms:
            self._began_s, self._first_ns = began_s, frame.t_ns
        observation = perceive(frame, self._segmenter).observation
        action = self._cadence.act(observation) if self._cadence is not None else None
        self._took_ms.append((time.perf_counter() - began_s) * 1e3)
        since_ns = frame.t_ns - self._first_ns
        when = f"age {(clock.now_ns() - frame.t_ns) / 1e6:.0f} ms" if clock else f"{since_ns / 1e9:.2f} s"
        picture = overlay(frame.rgb, observation, when, self._drive(observation, action))
        self._ended_s = time.perf_counter()
        self._count(observation)
        return Viewed(picture, observation, action)

    def summary(self) -> dict[str, Any]:
        """Return the counts: `tracked` is the share of frames in which the target was seen, `frame_ms` what
        perception and policy take of each, without the drawing.
        """
        frames, elapsed_s = len(self._took_ms), self._ended_s - self._began_s
        p50, p95 = np.percentile(self._took_ms, (50, 95)) if frames else (None, None)
        return {
            "frames": frames,
            "rate_hz": round(frames / elapsed_s, 2) if frames else None,
            "tracked": round(self._in_sight / frames, 4) if frames else None,
            "states": {name: self._states[name] for name in _state_names()},
            "frame_ms": {
                "p50": None if p50 is None else round(float(p50), 2),
                "p95": None if p95 is None else round(float(p95), 2),
            },
        }

    def _count(self, observation: Observation) -> None:
        self._in_sight += observation.box is not None
        state = observation.target
        if state is None and observation.box is not None:
            state = TargetState.TRACKED  # a rehearsal knows who it is
        self._states[state.value if state else UNCHOSEN] += 1

    def _drive(self, observation: Observation, action: Action | None) -> Drive | None:
        if self._policy is None:
            return None
        moves: dict[str, float] | None = None
        if action is not None:
            signed = zip(self._policy.info.action, map(float, action.values), strict=True)
            moves = {entry.axis: value * entry.sign for entry, value in signed}
        sees = self._policy.picture(observation) if isinstance(self._policy, OnnxPolicy) else None
        return Drive(moves=moves, sees=sees)


def film_frames(camera: FilmCamera, clock: Clock, *, paced: bool) -> Iterator[Frame]:
    """Give every frame of an open film, at the film's times; `camera` gives every frame.

    Args:
        camera: made with `every_frame`.
        clock: the run's.
        paced: no frame is given before its time.
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
    """Give the newest frame whenever there is a new one; those that nobody was in time for are skipped.

    Raises:
        PlatformError: the camera is gone.
    """
    pacer, seen = Pacer(clock, _LOOK_HZ), 0
    while True:
        frame = camera.read(pacer.wait().t_ns)
        if frame is not None and frame.seq != seen:
            seen = frame.seq
            yield frame


def _state_names() -> list[str]:
    return [*(state.value for state in TargetState), UNCHOSEN]
