"""Lists the available policies and loads one by name."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.core.onnx_session import require_provider
from adatracker_deploy.hub.address import is_hub, parse_address

if TYPE_CHECKING:
    from adatracker_deploy.policy.base import Policy
    from adatracker_deploy.policy.bundle import Bundle

PID = "pid"
TOKEN = "ADATRACKER_POLICY_TOKEN"
"""The environment variable with the token that a remote policy's server wants."""
DEFAULT = "adatracker"
"""Used when none is named: the shipped bundle, whose model card tells what it scores."""
PATIENCE_S = 10.0
"""Longest time for which evaluations wait for an answer from another machine."""


def is_remote(name_or_dir: str) -> bool:
    """Return whether this is the address of a policy on another machine."""
    return name_or_dir.startswith(("ws://", "wss://"))


def load_policy(
    name_or_dir: str, provider: str = "cpu", *, prompt: str = "", patience_s: float | None = PATIENCE_S
) -> Policy:
    """Load a policy, ready for its first episode.

    Args:
        name_or_dir: `pid`, the name of a shipped bundle, a bundle's folder (anything with a slash, or a
            folder that exists), ``hf://OWNER/NAME@REVISION`` on the Hugging Face Hub, or ``ws://HOST:PORT``
            or ``wss://HOST:PORT`` of a server.
        provider: where its networks run: a key of `adatracker_deploy.core.onnx_session.PROVIDERS`.
        prompt: the instruction to a policy on another machine.
        patience_s: how long to wait for each answer from another machine; None for a robot's loop, which
            waits for half a period (`RemotePolicy`).

    Raises:
        UsageError: there is no such policy, its bundle is refused, or the provider is unavailable.
    """
    if provider != "cpu":
        require_provider(provider)  # also for a policy without networks: the provider must exist
    if name_or_dir == PID:
        from adatracker_deploy.policy.pid import PidPolicy

        return PidPolicy()
    if is_remote(name_or_dir):
        from adatracker_deploy.policy.remote import RemotePolicy

        token = os.environ.get(TOKEN, "")
        return RemotePolicy(name_or_dir, token=token, prompt=prompt, patience_s=patience_s)
    from adatracker_deploy.policy.onnx_policy import OnnxPolicy

    return OnnxPolicy(find_bundle(name_or_dir), (provider,))


def find_bundle(name_or_dir: str) -> Bundle:
    """Read and check a shipped bundle by name, one in a folder, or one on the Hub.

    Raises:
        UsageError: there is none, or it is refused.
    """
    from adatracker_deploy.policy.bundle import load_bundle

    if is_hub(name_or_dir):
        return _from_hub(name_or_dir)
    folder = _shipped().get(name_or_dir, Path(name_or_dir))
    if "/" not in name_or_dir and not folder.is_dir():
        known = ", ".join([PID, *_shipped()])
        raise UsageError(f"unknown policy {name_or_dir!r}: known are {known}; or give a bundle's folder")
    return load_bundle(folder)


def pinned(name_or_dir: str) -> str:
    """Return the same policy by a name that stays the same: a branch or tag on the Hub becomes its commit.

    For those who load it several times, in this process or others: the bundle is then in the cache.

    Raises:
        UsageError: it is on the Hub, and refused.
    """
    return _from_hub(name_or_dir).source if is_hub(name_or_dir) else name_or_dir


def _from_hub(text: str) -> Bundle:
    from adatracker_deploy.hub.client import fetch
    from adatracker_deploy.policy.bundle import FILE_NAMES, MANIFEST_NAME, load_bundle

    address = parse_address(text)
    if address.kind != "model":
        raise UsageError(f"{address}: is a dataset, and policies are models: hf://OWNER/NAME@REVISION")
    snapshot = fetch(address, FILE_NAMES)
    if not (snapshot.folder / MANIFEST_NAME).exists():
        raise UsageError(f"{snapshot.address}: is no policy bundle: it has no {MANIFEST_NAME}")
    try:
        return replace(load_bundle(snapshot.folder), source=str(snapshot.address))
    except UsageError as error:
        raise UsageError(f"{snapshot.address}: {error}") from error


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
