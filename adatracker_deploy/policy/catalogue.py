"""Lists the available policies and loads one by name."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from adatracker_deploy.policy.base import Policy

PID = "pid"
TOKEN = "ADATRACKER_POLICY_TOKEN"
"""The environment variable with the token that a remote policy's server wants."""
DEFAULT = "adatracker"
"""Used when none is named: the shipped bundle, whose model card tells what it scores."""


PATIENCE_S = 10.0
"""How long evaluations wait for an answer from another machine."""


def is_remote(name_or_dir: str) -> bool:
    """Return whether this is the address of a policy on another machine."""
    return name_or_dir.startswith(("ws://", "wss://"))


def load_policy(name_or_dir: str, *, prompt: str = "", patience_s: float | None = PATIENCE_S) -> Policy:
    """Load a policy, ready for its first episode.

    Args:
        name_or_dir: `pid`, the name of a shipped bundle, a bundle's folder (anything with a slash, or a
            folder that exists), or ``ws://HOST:PORT`` or ``wss://HOST:PORT`` of a server.
        prompt: what a policy on another machine is told to do.
        patience_s: how long to wait for each answer from another machine; None for a robot's loop, which
            waits for half a period (`RemotePolicy`).

    Raises:
        UsageError: there is no such policy, or its bundle is refused.
    """
    if name_or_dir == PID:
        from adatracker_deploy.policy.pid import PidPolicy

        return PidPolicy()
    if is_remote(name_or_dir):
        from adatracker_deploy.policy.remote import RemotePolicy

        token = os.environ.get(TOKEN, "")
        return RemotePolicy(name_or_dir, token=token, prompt=prompt, patience_s=patience_s)
    folder = _shipped().get(name_or_dir, Path(name_or_dir))
    if "/" not in name_or_dir and not folder.is_dir():
        known = ", ".join([PID, *_shipped()])
        raise UsageError(f"unknown policy {name_or_dir!r}: there are {known}; or give a bundle's folder")
    from adatracker_deploy.policy.bundle import load_bundle
    from adatracker_deploy.policy.onnx_policy import OnnxPolicy

    return OnnxPolicy(load_bundle(folder))


def describe_policies() -> dict[str, str]:
    """Return one line about each policy that can be asked for by name."""
    return {PID: "PID on the target's box, 20 Hz: the baseline"} | {
        name: _describe(folder) for name, folder in _shipped().items()
    }


def _describe(folder: Path) -> str:
    from adatracker_deploy.policy.bundle import read_manifest

    try:
        manifest = read_manifest(folder)
    except UsageError as error:
        return f"unusable: {error}"
    summary, _, _ = manifest.training.strip().partition("\n")
    return f"{summary}, {manifest.rate_hz:g} Hz"


def _shipped() -> dict[str, Path]:
    """Return the bundles inside the installed package, by name."""
    bundles = Path(__file__).parent / "bundles"
    return {path.parent.name: path.parent for path in sorted(bundles.glob("*/manifest.yaml"))}
