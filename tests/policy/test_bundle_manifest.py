"""A manifest is complete, in range and free of contradictions, or the bundle is refused."""

from __future__ import annotations

from dataclasses import fields

import pytest

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.policy.bundle import Manifest, read_manifest
from tests.policy.tampering import put, refusal, reseal, write_sealed


@pytest.mark.parametrize(
    "key", [field.name for field in fields(Manifest) if field.name not in {"response", "search"}]
)
def test_a_missing_field_is_refused_by_name(folder, key):
    reseal(folder, lambda document: document.pop(key) and None)
    assert f"missing key {key!r}" in refusal(folder) or f"{key} must list exactly" in refusal(folder)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (put("colour", value=1), "unknown key 'colour'"),
        (put("mask", "palette", "sky", value=[0, 0, 0]), "palette: unknown key 'sky'"),
        (put("format", value=2), "bundle format 2 is unknown; this program reads format 1"),
        (put("format", value="one"), "bundle format 'one' is unknown"),
        (put("interface", value="telepathy"), "expected one of 'streaming', 'window', 'none'"),
        (put("history", value=0), "history must be at least 1 where interface is 'streaming'"),
        (put("context", value=0), "context must be at least 1 where interface is 'streaming'"),
        (put("interface", value="none"), "history must be 0 where interface is 'none'"),
        (put("history", value=4), "history [1, 4, 6] float32; got mask"),
        (put("context", value=9), "encoder.outputs: expected z [1, 9] float32"),
        (put("encoder", value=None), "encoder: must be given with this interface"),
        (put("mask", "size", value=16), "encoder.inputs: expected mask [1, 3, 16, 16] float32"),
        (put("mask", "channels", value=1), "palette.background: expected 1 values, got 3"),
        (put("mask", "palette", "target", value=[256, 0, 0]), "256 is out of range [0, 255]"),
        (put("mask", "palette", "person", value="any"), "expected one of 'random', got str 'any'; or"),
        (put("mask", "scale", value=0), "scale: 0.0 is out of range"),
        (put("rate_hz", value=1e9), "rate_hz: 1000000000.0 is out of range"),
        (put("action", value=[]), "action must name at least one axis and none twice, got []"),
        (put("action", 1, "axis", value="yaw"), "none twice, got ['yaw', 'yaw']"),
        (put("action", 0, "sign", value=2), "sign: expected one of -1, 1"),
        (put("action", value=[{"axis": "yaw"}]), "expected mask [1, 3, 8, 8] float32, action [1, 1]"),
        (put("policy", "inputs", 2, "name", value="hidden"), "policy.inputs: expected"),
        (put("policy", "outputs", 0, "dtype", value="float16"), "dtype: expected one of 'float32'"),
        (put("opset", value=17), "encoder.onnx: uses opset [18], but the manifest says 17"),
        (put("files", "more.bin", value={"sha256": "", "bytes": 0}), "files must list exactly encoder.onnx"),
        (put("files", "../policy.onnx", value={"sha256": "", "bytes": 0}), "files must list exactly"),
        (lambda _: [1, 2], "expected a mapping, got list"),
    ],
)
def test_a_manifest_that_contradicts_itself_or_its_files_is_refused(folder, change, reason):
    reseal(folder, change)
    assert reason in refusal(folder)


@pytest.mark.parametrize("body", [b"a: [", b"\xff\xfe\xff", b"[" * 20_000, b"a: 2024-99-99", b"? {} : 1"])
def test_what_is_not_yaml_is_refused(folder, body):
    write_sealed(folder / "manifest.yaml", body)
    assert "manifest.yaml: " in refusal(folder)


def test_a_manifest_edited_by_hand_is_refused(folder):
    path = folder / "manifest.yaml"
    path.write_text(path.read_text().replace("rate_hz: 10.0", "rate_hz: 20.0"))
    assert "manifest.yaml: has changed since the bundle was written" in refusal(folder)
    with pytest.raises(UsageError, match="has changed"):
        read_manifest(folder)
