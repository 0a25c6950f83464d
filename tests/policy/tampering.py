"""Ways to change a bundle on disk as its author could, and to hear what the loader says."""

from __future__ import annotations

import hashlib

import pytest
import yaml

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.policy.bundle import load_bundle


def refusal(folder):
    """Load, and return the sentence that refuses."""
    with pytest.raises(UsageError) as refused:
        load_bundle(folder)
    assert len(str(refused.value).splitlines()) == 1
    return str(refused.value)


def reseal(folder, change):
    """Change the manifest as its author would, seal and all."""
    path = folder / "manifest.yaml"
    document = yaml.safe_load(path.read_text())
    document = change(document) or document
    write_sealed(path, yaml.safe_dump(document).encode())


def write_sealed(path, body):
    path.write_bytes(
        b"# sha256 of all that follows: " + hashlib.sha256(body).hexdigest().encode() + b"\n" + body
    )


def put(*path, value):
    def change(document):
        for key in path[:-1]:
            document = document[key]
        document[path[-1]] = value

    return change


def replace_file(folder, name, content):
    """Replace a file and tell the manifest, as whoever made the bundle could."""
    (folder / name).write_bytes(content)
    spec = {"sha256": hashlib.sha256(content).hexdigest(), "bytes": len(content)}
    reseal(folder, put("files", name, value=spec))
