"""Lists the available policies and loads one by name."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from adatracker_deploy.policy.base import Policy

PID = "pid"
DEFAULT = "adatracker"
"""Used when none is named: the shipped bundle, whose model card tells what it scores."""


def load_policy(name_or_dir: str) -> Policy:
    """Load a policy, ready for its first episode.

    Args:
        name_or_dir: `pid`, the name of a shipped bundle, or a bundle's folder: anything with a slash, or a
            folder that exists.

    Raises:
        UsageError: there is no such policy, or its bundle is refused.
    """
    if name_or_dir == PID:
        from adatracker_deploy.policy.pid import PidPolicy

        return PidPolicy()
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
