"""The messages to and from a policy on another machine: pure functions, without a socket.

The messages are openpi's: metadata first, then observations and answers in turn. What is ours lies in the
metadata under ``adatracker`` (`Contract`); docs/remote.md has the whole of it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np

from adatracker_deploy.config.schema import Range, parse
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.policy.base import ActionAxis, PolicyInfo

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from adatracker_deploy.core.messages import Observation, PlatformState

KEY = "adatracker"
"""Key of the metadata under which a server states its contract."""
LONGEST_CHUNK = 1024
"""Rows of a chunk; more is a mistake of shapes."""
LONGEST_CONTEXT = 4096
"""Numbers of a context, as in a bundle's manifest."""

Observed = Literal["mask", "box", "confidence", "image", "state", "prompt"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Contract:
    """A server's contract: the policy's name, its inputs, and the units of its outputs."""

    name: str
    rate_hz: Annotated[float, Range(1, 100)]
    """Rate at which the robot asks and acts, and of a chunk's rows."""
    action: tuple[ActionAxis, ...]
    observation: tuple[Observed, ...] = ("mask",)
    sha256: dict[str, str] = field(default_factory=dict)
    """Digests of what it was loaded from, by file."""
    runs_on: str = ""
    """The execution provider that the server's network was granted; empty where it does not say."""

    def info(self, server: str) -> PolicyInfo:
        """Return what the loop and the log need to know; `server` is its address."""
        return PolicyInfo(
            name=self.name,
            rate_hz=self.rate_hz,
            action=self.action,
            sha256=tuple(self.sha256.items()),
            server=server,
            runs_on=self.runs_on,
        )


@dataclass(frozen=True, slots=True)
class Reply:
    """A server's answer to one observation."""

    actions: NDArray[np.float32]
    """Shape (H, A): one row for each period from its picture on."""
    context: NDArray[np.float32] | None
    request: int | None
    """The number of the request that it answers; None from servers that do not repeat it."""
    server_ms: float | None
    """Inference time, by the server's clock."""
    searching: bool = False
    """See `Action.searching`."""


def written(info: PolicyInfo, observed: tuple[Observed, ...]) -> dict[str, Any]:
    """Return a policy's contract as metadata."""
    return {
        KEY: {
            "name": info.name,
            "rate_hz": info.rate_hz,
            "action": [{"axis": entry.axis, "sign": entry.sign, "unit": entry.unit} for entry in info.action],
            "observation": list(observed),
            "sha256": dict(info.sha256),
            "runs_on": info.runs_on,
        }
    }


def read_contract(metadata: Any) -> Contract:
    """Return the contract in a server's metadata; keys that are not known here are left aside.

    Raises:
        UsageError: there is none, or it is refused.
    """
    said = metadata.get(KEY) if isinstance(metadata, dict) else None
    if not isinstance(said, dict):
        raise UsageError(
            f"its metadata lacks a contract: it needs {KEY}: {{name, rate_hz, action, observation}}"
        )
    known = {name: value for name, value in said.items() if name in Contract.__dataclass_fields__}
    contract = parse(Contract, known, where="its metadata")
    if not contract.name.isprintable() or not 0 < len(contract.name) <= 64:
        raise UsageError("its metadata: name: expected 1 to 64 printable characters")
    if contract.runs_on and not (contract.runs_on.isprintable() and len(contract.runs_on) <= 64):
        raise UsageError("its metadata: runs_on: expected at most 64 printable characters")
    axes = [entry.axis for entry in contract.action]
    if not axes or len(axes) != len(set(axes)):
        raise UsageError(f"its metadata: action must name at least one axis and none twice, got {axes}")
    return contract


def request(
    contract: Contract, observation: Observation, *, number: int, seed: int | None, prompt: str
) -> dict[str, Any]:
    """Return an observation as it is sent: what the contract names, and what every message has.

    Args:
        contract: the server's.
        observation: what is seen.
        number: identifies the request.
        seed: of the episode that begins with it; None within one.
        prompt: the instruction.
    """
    box, image, state = observation.box, observation.image, observation.state
    whole: dict[Observed, Any] = {
        "mask": observation.mask,
        "box": None if box is None else np.array([box.cx, box.cy, box.w, box.h], np.float32),
        "confidence": observation.confidence,
        "image": image,
        "state": None if state is None else _state(state),
        "prompt": prompt,
    }
    said = {"request": number, "seq": observation.seq, "t_ns": observation.t_ns}
    if seed is not None:
        said["reset"] = seed
    return said | {name: whole[name] for name in contract.observation}


def read_reply(said: Any, axes: int) -> Reply:
    """Return an answer.

    Args:
        said: the unpacked message.
        axes: numbers of an action, A.

    Raises:
        ValueError: it has no actions of the contract's shape.
    """
    if not isinstance(said, dict):
        raise ValueError("an answer without actions")  # noqa: TRY004 -- one kind of error for what is wrong
    actions, number = said.get("actions"), said.get("request")
    if not isinstance(actions, np.ndarray) or actions.dtype.kind not in "fiu" or actions.ndim not in (1, 2):
        raise ValueError("an answer without actions, an array of numbers")
    rows = np.atleast_2d(actions).astype(np.float32)
    if rows.shape[1] != axes or not 0 < len(rows) <= LONGEST_CHUNK:
        raise ValueError(f"actions of shape {actions.shape}: expected ({axes},) or (H, {axes})")
    searching = said.get("searching") is True
    return Reply(rows, _context(said.get("context")), _whole(number), _inference_ms(said), searching)


def _state(state: PlatformState) -> dict[str, Any]:
    pose, velocity = state.pose, state.velocity
    return {
        "pose": None
        if pose is None
        else np.array([pose.x, pose.y, pose.z, pose.roll, pose.pitch, pose.yaw], np.float32),
        "velocity": None
        if velocity is None
        else np.array([velocity.vx, velocity.vy, velocity.vz, velocity.yaw_rate], np.float32),
        "battery": state.battery,
        "t_ns": state.t_ns,
    }


def _context(said: Any) -> NDArray[np.float32] | None:
    if said is None:
        return None
    if not isinstance(said, np.ndarray) or said.dtype.kind != "f" or said.ndim != 1:
        raise ValueError("a context that is not an array of numbers")
    if said.size > LONGEST_CONTEXT:
        raise ValueError(f"a context of {said.size} numbers: expected at most {LONGEST_CONTEXT}")
    return said.astype(np.float32)


def _whole(said: Any) -> int | None:
    if said is not None and (not isinstance(said, int) or isinstance(said, bool)):
        raise ValueError("an answer whose request is not a number")
    return said


def _inference_ms(said: dict[str, Any]) -> float | None:
    timing = said.get("server_timing")
    taken_ms = timing.get("infer_ms") if isinstance(timing, dict) else None
    if isinstance(taken_ms, int | float) and 0 <= taken_ms < 1e9:
        return float(taken_ms)
    return None
