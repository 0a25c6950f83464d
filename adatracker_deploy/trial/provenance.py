"""Provenance of a trial: the command, the toolkit's version and commit, the libraries, the machine."""

from __future__ import annotations

import json
import os
import platform as machine
import shlex
import subprocess
import sys
from importlib.metadata import Distribution, PackageNotFoundError, version
from pathlib import Path

import cv2
import onnxruntime as ort

from adatracker_deploy import __version__
from adatracker_deploy.core.camera import without_password

_GIT_TIMEOUT_S = 2.0
_CHECKOUT = Path(__file__).parents[2]


def provenance() -> dict[str, str]:
    """Return all of it by name, as texts."""
    return {"command": shlex.join(map(without_password, sys.argv)), **surroundings()}


def surroundings() -> dict[str, str]:
    """Return what the numbers of a trial may depend on, by name; the commit only where it is known."""
    known = {
        "adatracker-deploy": __version__,
        "commit": commit(_CHECKOUT),
        "python": machine.python_version(),
        "machine": machine.platform(),
        **{name: version(name) for name in ("mcap", "numpy")},
        "onnxruntime": ort.__version__,  # its package is onnxruntime or onnxruntime-gpu
        "opencv": cv2.__version__,  # it reduces masks to what networks see
    }
    return {name: text for name, text in known.items() if text}


def commit(checkout: Path) -> str:
    """Return the Git commit that this toolkit was installed from; empty where that is unknown.

    Args:
        checkout: the folder that would be a clone; then ``-dirty`` follows where tracked files were changed.
    """
    if (checkout / ".git").exists():
        return _described(checkout)
    try:  # pip leaves it where it installed from a repository's address (PEP 610)
        origin = json.loads(Distribution.from_name("adatracker-deploy").read_text("direct_url.json") or "{}")
        return str(origin["vcs_info"]["commit_id"])
    except (PackageNotFoundError, ValueError, KeyError, TypeError):
        return ""


def _described(checkout: Path) -> str:
    try:
        done = subprocess.run(
            ("git", "-C", str(checkout), "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"),
            capture_output=True,
            text=True,
            timeout=_GIT_TIMEOUT_S,
            check=True,
            env={**os.environ, "GIT_OPTIONAL_LOCKS": "0"},
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()
