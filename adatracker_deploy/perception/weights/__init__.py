"""The perception models that are shipped, as ONNX.

`models.yaml` says of each what it is, its inputs and outputs, SHA-256 and how it was made
(`tools/convert_perception.py`); `NOTICE` says whose work they are and under which licences.
"""

from __future__ import annotations

import functools
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from adatracker_deploy.core.errors import UsageError

if TYPE_CHECKING:
    from adatracker_deploy.perception.models.model_file import ModelFile

INDEX_NAME = "models.yaml"


def shipped(name: str) -> ModelFile:
    """Read a shipped model and see that it is the one that was shipped.

    Args:
        name: the file's, as in `models.yaml`.

    Raises:
        UsageError: it is missing, or its SHA-256 is another.
    """
    from adatracker_deploy.perception.models.model_file import read_model_file

    file = read_model_file(Path(str(files(__name__) / name)))
    digest = file.sha256[0][1]
    if digest != _digests()[name]:
        raise UsageError(
            f"{file.path}: SHA-256 {digest[:12]} is not the shipped file's: install the package anew"
        )
    return file


@functools.cache
def _digests() -> dict[str, str]:
    index: dict[str, Any] = yaml.safe_load((files(__name__) / INDEX_NAME).read_text(encoding="utf-8"))
    return {
        name: entry["sha256"] for model in index["models"].values() for name, entry in model["files"].items()
    }
