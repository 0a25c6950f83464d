"""A bundle is what its manifest says to the byte, or it is refused in one sentence that names the file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from adatracker_deploy.core.errors import UsageError
from adatracker_deploy.policy.base import ActionAxis
from adatracker_deploy.policy.bundle import load_bundle, read_manifest, write_bundle
from tests.policy import tiny
from tests.policy.tampering import refusal

FILES = ("manifest.yaml", "policy.onnx", "encoder.onnx", "golden.npz")


@pytest.mark.parametrize("interface", ["streaming", "window", "none"])
def test_what_is_written_is_read_back(tmp_path, interface):
    parts = tiny.Parts(interface)
    manifest = parts.write(tmp_path / "new" / "bundle")
    bundle = load_bundle(tmp_path / "new" / "bundle")
    assert bundle.manifest == manifest == replace(parts.manifest, files=manifest.files)
    assert bundle.policy == parts.policy.SerializeToString()
    assert (bundle.encoder is None) == (interface == "none")
    for name, array in parts.golden.items():
        np.testing.assert_array_equal(bundle.golden[name], array)


def test_writing_replaces_the_bundle_that_was_there(written, folder):
    parts = tiny.Parts("none")
    parts.write(folder)
    assert load_bundle(folder).manifest.interface == "none"
    assert not (folder / "encoder.onnx").exists()


def test_parts_that_make_no_bundle_leave_no_manifest(folder):
    parts = tiny.Parts()
    parts.golden["z"] = parts.golden["z"][:3]
    with pytest.raises(UsageError, match=r"golden.npz: expected .*z \[24, 3\] float32.* got .*z \[3, 3\]"):
        parts.write(folder)
    assert "manifest.yaml: is missing" in refusal(folder)


def test_a_folder_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="cannot be written"):
        tiny.Parts("none").write(tmp_path / "file")


def test_an_encoder_that_the_manifest_does_not_know_is_refused(tmp_path):
    parts = tiny.Parts("none")
    with pytest.raises(UsageError, match=r"manifest.yaml: files must list exactly golden.npz, policy.onnx$"):
        write_bundle(
            tmp_path,
            parts.manifest,
            encoder=tiny.encoder_model().SerializeToString(),
            policy=parts.policy.SerializeToString(),
            golden=parts.golden,
        )


@pytest.mark.parametrize("name", FILES)
def test_a_missing_file_is_refused(folder, name):
    (folder / name).unlink()
    assert f"{name}: is missing" in refusal(folder)


@pytest.mark.parametrize("name", FILES)
@given(data=st.data())
def test_any_changed_byte_is_refused(written, tmp_path_factory, name, data):
    folder = tmp_path_factory.mktemp("changed")
    for file in written.iterdir():
        (folder / file.name).hardlink_to(file)
    content = bytearray((written / name).read_bytes())
    at = data.draw(st.integers(0, len(content) - 1))
    content[at] ^= data.draw(st.integers(1, 255))
    (folder / name).unlink()
    (folder / name).write_bytes(content)
    sentence = refusal(folder)
    assert f"{folder}/{name}: " in sentence
    if name != "manifest.yaml":
        assert f"{name}: has changed: SHA-256" in sentence


@pytest.mark.parametrize("name", FILES[1:])
def test_a_cut_or_grown_file_is_refused_by_its_size(folder, name):
    content = (folder / name).read_bytes()
    for changed in (content[:-1], content + b"\0", b""):
        (folder / name).write_bytes(changed)
        assert f"{name}: has changed: {len(changed)} bytes, but the manifest says {len(content)}" in refusal(
            folder
        )


@pytest.mark.parametrize("name", FILES)
def test_a_file_over_the_cap_is_refused_unread(folder, name):
    with (folder / name).open("r+b") as file:
        file.truncate((64 << 20) + 1)
    assert f"{name}: is larger than" in refusal(folder)


def test_a_plain_file_is_no_bundle(tmp_path):
    (tmp_path / "policy.onnx").write_bytes(b"")
    assert "is not a policy bundle: no such folder" in refusal(tmp_path / "policy.onnx")


def test_axes_and_signs_come_back_as_the_manifest_states_them(written):
    assert read_manifest(written).action == (
        ActionAxis(axis="yaw", sign=-1),
        ActionAxis(axis="forward", sign=1),
    )
