"""A bundle on disk, and a copy of it to break."""

from __future__ import annotations

import shutil

import pytest

from tests.policy import tiny


@pytest.fixture(scope="session")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bundle")
    tiny.Parts().write(folder)
    return folder


@pytest.fixture
def folder(written, tmp_path):
    return shutil.copytree(written, tmp_path / "copy")
