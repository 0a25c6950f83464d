"""A Hub of this machine, which the client speaks to instead of the real one, and an empty cache."""

from __future__ import annotations

import socket

import pytest

pytest.importorskip("huggingface_hub")
from huggingface_hub import _tree_cache, constants

from adatracker_deploy.core.ports import unused_port
from tests.hub.server import Hub, serving
from tests.policy import tiny


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty cache of the client's, which reads its environment once, when it is imported."""
    folder = tmp_path / "hf"
    point_at(monkeypatch, nowhere())
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(folder))
    monkeypatch.setattr(constants, "HF_TOKEN_PATH", str(tmp_path / "no-token"))
    monkeypatch.setattr(constants, "HF_HUB_DISABLE_XET", True)
    monkeypatch.setattr(_tree_cache, "_IN_MEMORY_TREE_CACHE", {})
    monkeypatch.delenv("HF_TOKEN", raising=False)
    return folder


@pytest.fixture
def hub(cache, monkeypatch):
    held = Hub()
    with serving(held) as address:
        point_at(monkeypatch, address)
        yield held


@pytest.fixture
def no_network(monkeypatch):
    """Cuts the client off from the Hub."""
    return lambda: point_at(monkeypatch, nowhere())


def point_at(monkeypatch, address):
    monkeypatch.setattr(constants, "ENDPOINT", address)
    template = address + "/{repo_id}/resolve/{revision}/{filename}"
    monkeypatch.setattr(constants, "HUGGINGFACE_CO_URL_TEMPLATE", template)


def nowhere():
    """An address of this machine where nobody listens."""
    return f"http://127.0.0.1:{unused_port(socket.SOCK_STREAM)}"


@pytest.fixture(scope="session")
def bundle_files(tmp_path_factory):
    """A small bundle, by file name."""
    folder = tmp_path_factory.mktemp("bundle")
    tiny.Parts().write(folder)
    return {path.name: path.read_bytes() for path in folder.iterdir()}
