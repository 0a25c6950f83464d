"""Wrappers around camera, segmenter and policy that inject faults while a switch is on."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from adatracker_deploy.core.camera import Camera
    from adatracker_deploy.core.messages import Action, Frame, Observation
    from adatracker_deploy.perception.segmenter import Segmenter
    from adatracker_deploy.policy.base import Policy, PolicyInfo

POLL_S = 0.005


class Switch:
    """Switches the faults of wrapped parts on and off; thread-safe.

    Args:
        struck: called in the part's thread when the fault first takes effect.
    """

    def __init__(self, struck: Callable[[str], None]) -> None:
        self._struck = struck
        self._on: dict[str, bool] = {}
        """Active faults, and whether each has taken effect."""
        self._over = threading.Event()

    def begin(self, name: str) -> None:
        """Switch a fault on; it takes effect at the next use of its part."""
        self._on[name] = False

    def end(self, name: str) -> None:
        """Switch a fault off."""
        self._on.pop(name, None)

    def strikes(self, name: str) -> bool:
        """Return whether a fault is on; report it the first time."""
        if name not in self._on:
            return False
        if not self._on[name]:
            self._on[name] = True
            self._struck(name)
        return True

    def hang(self, name: str) -> None:
        """Block until the hang fault is off."""
        while name in self._on:
            self._over.wait(POLL_S)


class FrozenCamera:
    """A camera that can freeze in this process; a simulator's own camera freezes in the simulator."""

    def __init__(self, whole: Camera, switch: Switch) -> None:
        self._whole = whole
        self._switch = switch
        self._last: Frame | None = None
        self.open, self.close, self.go = whole.open, whole.close, whole.go

    def read(self, now_ns: int) -> Frame | None:
        """Return the newest frame, or while frozen the last one again."""
        if self._last is None or not self._switch.strikes("camera_freeze"):
            self._last = self._whole.read(now_ns)
        return self._last


class FaultySegmenter:
    """A segmenter that can stall, or fail."""

    def __init__(self, whole: Segmenter, switch: Switch) -> None:
        self._whole = whole
        self._switch = switch
        self.needs_truth = whole.needs_truth
        self.reset = whole.reset

    def __call__(self, frame: Frame) -> Observation:
        """Return the wrapped segmenter's result, late or never."""
        if self._switch.strikes("segmenter_error"):
            raise RuntimeError("the fault segmenter_error was asked for")
        if self._switch.strikes("segmenter_stall"):
            self._switch.hang("segmenter_stall")
        return self._whole(frame)


class FaultyPolicy:
    """A policy that can hang, return NaN, or jump between extremes."""

    def __init__(self, whole: Policy, switch: Switch) -> None:
        self._whole = whole
        self._switch = switch
        self._end = np.float32(1)
        self.reset = whole.reset

    @property
    def info(self) -> PolicyInfo:
        """The wrapped policy's info."""
        return self._whole.info

    def act(self, observation: Observation) -> Action:
        """Return the wrapped policy's action, or a faulty one."""
        if self._switch.strikes("policy_hang"):
            self._switch.hang("policy_hang")
        action = self._whole.act(observation)
        if self._switch.strikes("policy_nan"):
            return replace(action, values=np.full_like(action.values, np.nan))
        if self._switch.strikes("policy_inf"):
            return replace(action, values=np.full_like(action.values, np.inf))
        if self._switch.strikes("action_jump"):
            self._end = -self._end
            return replace(action, values=np.full_like(action.values, self._end))
        return action
