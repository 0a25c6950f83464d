"""Fixtures of perception's tests."""

from __future__ import annotations

import pytest

from adatracker_deploy.perception.target import first_sight


@pytest.fixture
def chosen_at_once(monkeypatch):
    """The first picture chooses the target: for tests of what comes after."""
    monkeypatch.setattr(first_sight, "TRUSTED_SIGHTS", 1)
    monkeypatch.setattr(first_sight, "TRUSTED_S", 0.0)
