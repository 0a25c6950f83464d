"""Policy bundles on disk: folders whose content must match their manifest to the byte.

    manifest.yaml   what the policy is; its first line seals the rest
    policy.onnx     (mask, z, h, c) -> (action, h_next, c_next); last_action and belief among the inputs
                    where they are used
    encoder.onnx    mask-action pairs -> z; not there where the interface is `none`
    golden.npz      inputs from a reset on, and the answers to them

Digests and seal find damage and mix-ups, not forgery: whoever can write the folder can write them too.
"""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from adatracker_deploy.config.schema import parse
from adatracker_deploy.config.yaml_text import parse_yaml
from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.policy.golden import GOLDEN_TICKS, Golden, pack_golden, unpack_golden
from adatracker_deploy.policy.manifest import (
    FORMAT,
    FileSpec,
    GraphSpec,
    Manifest,
    MaskSpec,
    Palette,
    TensorSpec,
    check_manifest,
)
from adatracker_deploy.policy.onnx_graph import check_graph

__all__ = [
    "CARD_NAME",
    "ENCODER_NAME",
    "FILE_NAMES",
    "FORMAT",
    "GOLDEN_NAME",
    "GOLDEN_TICKS",
    "MANIFEST_NAME",
    "POLICY_NAME",
    "Bundle",
    "FileSpec",
    "Golden",
    "GraphSpec",
    "Manifest",
    "MaskSpec",
    "Palette",
    "TensorSpec",
    "load_bundle",
    "read_manifest",
    "write_bundle",
]

MANIFEST_NAME, POLICY_NAME, ENCODER_NAME = "manifest.yaml", "policy.onnx", "encoder.onnx"
GOLDEN_NAME = "golden.npz"
FILE_NAMES = (MANIFEST_NAME, POLICY_NAME, ENCODER_NAME, GOLDEN_NAME)
"""All that a bundle may consist of."""
CARD_NAME = "MODEL_CARD.md"
"""Tells people about the policy; beside the bundle's files, and none of them."""

_MANIFEST_CAP_BYTES = 64 << 10
_FILE_CAP_BYTES = 64 << 20
_SEAL = "# sha256 of all that follows: "


@dataclass(frozen=True, slots=True, kw_only=True)
class Bundle:
    """A bundle whose manifest, bytes, graphs and shapes were checked; `OnnxPolicy` checks the answers."""

    folder: Path
    manifest: Manifest
    encoder: bytes | None
    policy: bytes
    golden: Golden
    sha256: tuple[tuple[str, str], ...]
    """(file, digest), the manifest's own among them."""
    source: str = ""
    """Its address and commit on the Hub; empty for one of this machine."""


def load_bundle(folder: Path) -> Bundle:
    """Read and check a bundle; nothing of it has run yet.

    Each file is read once, and what was checked is what is used.

    Raises:
        UsageError: one line that names the file and the reason.
    """
    manifest, text = _read_manifest(folder)
    contents = {name: _read_file(folder / name, spec) for name, spec in manifest.files.items()}
    where = str(folder)
    if manifest.encoder is not None:
        check_graph(contents[ENCODER_NAME], manifest.encoder, manifest.opset, where=f"{where}/{ENCODER_NAME}")
    check_graph(contents[POLICY_NAME], manifest.policy, manifest.opset, where=f"{where}/{POLICY_NAME}")
    return Bundle(
        folder=folder,
        manifest=manifest,
        encoder=contents.get(ENCODER_NAME),
        policy=contents[POLICY_NAME],
        golden=unpack_golden(contents[GOLDEN_NAME], manifest, where=f"{where}/{GOLDEN_NAME}"),
        sha256=(
            (MANIFEST_NAME, hashlib.sha256(text).hexdigest()),
            *((name, spec.sha256) for name, spec in sorted(manifest.files.items())),
        ),
    )


def read_manifest(folder: Path) -> Manifest:
    """Read and check a bundle's manifest alone, as lists of policies need it.

    Raises:
        UsageError: one line that names the file and the reason.
    """
    return _read_manifest(folder)[0]


def write_bundle(
    folder: Path, manifest: Manifest, *, encoder: bytes | None, policy: bytes, golden: Golden
) -> Manifest:
    """Write a bundle and read it back: what this returns from, `load_bundle` accepts.

    Args:
        folder: made where it does not exist; a bundle in it is replaced.
        manifest: with `files` empty.
        encoder: the encoder's ONNX file; None where the interface is `none`.
        policy: the policy's ONNX file.
        golden: see `Golden`.

    Returns:
        The manifest with `files` filled in.

    Raises:
        UsageError: these parts are no bundle; the folder then holds no manifest.
    """
    contents = {POLICY_NAME: policy, GOLDEN_NAME: pack_golden(golden)}
    if encoder is not None:
        contents[ENCODER_NAME] = encoder
    files = {
        name: FileSpec(sha256=hashlib.sha256(data).hexdigest(), bytes=len(data))
        for name, data in contents.items()
    }
    manifest = replace(manifest, files=files)
    path = folder / MANIFEST_NAME
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in FILE_NAMES:
            (folder / name).unlink(missing_ok=True)
        for name, data in contents.items():
            (folder / name).write_bytes(data)
        path.write_bytes(_sealed(manifest))
    except OSError as error:
        raise UsageError(f"{folder}: cannot be written: {error}") from error
    try:
        return load_bundle(folder).manifest
    except UsageError:
        path.unlink()
        raise


def _sealed(manifest: Manifest) -> bytes:
    body = yaml.safe_dump(_plain(asdict(manifest)), sort_keys=False, default_flow_style=None).encode()
    return f"{_SEAL}{hashlib.sha256(body).hexdigest()}\n".encode() + body


def _plain(value: Any) -> Any:
    """Turn tuples into lists, which YAML has."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def _read_manifest(folder: Path) -> tuple[Manifest, bytes]:
    """Return the manifest and the bytes it was read from."""
    if not folder.is_dir():
        raise UsageError(f"{folder}: is not a policy bundle: no such folder")
    path = folder / MANIFEST_NAME
    text = _read(path, _MANIFEST_CAP_BYTES)
    document = parse_yaml(text, where=str(path))
    version = document.get("format") if isinstance(document, dict) else None
    if version is not None and version != FORMAT:
        raise UsageError(f"{path}: bundle format {version!r} is unknown; this program reads format {FORMAT}")
    manifest = parse(Manifest, document, where=str(path))
    check_manifest(manifest, where=str(path))
    expected = {POLICY_NAME, GOLDEN_NAME} | ({ENCODER_NAME} if manifest.encoder else set())
    if manifest.files.keys() != expected:
        raise UsageError(f"{path}: files must list exactly {', '.join(sorted(expected))}")
    seal, _, body = text.partition(b"\n")
    if seal != f"{_SEAL}{hashlib.sha256(body).hexdigest()}".encode():
        raise UsageError(f"{path}: has changed since the bundle was written; export the bundle again")
    return manifest, text


def _read_file(path: Path, spec: FileSpec) -> bytes:
    data = _read(path, _FILE_CAP_BYTES)
    if len(data) != spec.bytes:
        raise UsageError(f"{path}: has changed: {len(data)} bytes, but the manifest says {spec.bytes}")
    if (digest := hashlib.sha256(data).hexdigest()) != spec.sha256:
        raise UsageError(
            f"{path}: has changed: SHA-256 {digest[:12]}..., but the manifest says {spec.sha256[:12]}..."
        )
    return data


def _read(path: Path, cap_bytes: int) -> bytes:
    try:
        with path.open("rb") as file:
            data = file.read(cap_bytes + 1)
    except FileNotFoundError as error:
        raise UsageError(f"{path}: is missing") from error
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error}") from error
    if len(data) > cap_bytes:
        raise UsageError(f"{path}: is larger than {cap_bytes >> 10} KiB")
    return data
